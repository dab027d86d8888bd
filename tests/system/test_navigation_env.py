# SPDX-License-Identifier: Apache-2.0
"""System tests of the Gymnasium environment, with real processes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from groundlink.core.errors import UserError
from groundlink.sim import navigation_env
from groundlink.sim.navigation_env import NavigationEnv

from .rig import REPOSITORY

pytestmark = pytest.mark.system

GOALS = ((-3.0, 0.5), (-2.5, -0.8))


def scenario(folder: Path) -> Path:
    """Write the shipped scenario with a 2D scanner, without its route."""
    text = (REPOSITORY / "scenarios" / "indoor_2d.yaml").read_text(encoding="utf-8")
    text = text[: text.index("    route:")]
    for folder_name in ("worlds", "vehicles", "sensors"):
        text = text.replace(f" {folder_name}/", f" {REPOSITORY}/scenarios/{folder_name}/")
    (folder / "navigation.yaml").write_text(text, encoding="utf-8")
    return folder / "navigation.yaml"


@pytest.fixture(scope="module")
def env(tmp_path_factory: pytest.TempPathFactory) -> Iterator[NavigationEnv]:
    file = scenario(tmp_path_factory.mktemp("env"))
    made = NavigationEnv(file, goals_m=GOALS, scan="scanner", max_steps=60)
    yield made
    made.close()


def drive(env: Any, seed: int) -> tuple[list[Any], float, bool]:
    """Return the observations on the way to the goal, the sum of rewards and how it ended."""
    observation, _ = env.reset(seed=seed)
    seen, rewards = [observation], 0.0
    while True:
        ahead, left = seen[-1]["goal"]
        turn = float(np.clip(2 * np.arctan2(left, ahead), -1, 1))
        observation, reward, reached, is_over, _ = env.step(np.array([0.8, turn], np.float32))
        seen.append(observation)
        rewards += reward
        if reached or is_over:
            return seen, rewards, reached


def test_gymnasium_accepts_it(env: NavigationEnv) -> None:
    check_env(env, skip_render_check=True)


def test_the_goal_is_reached_and_the_same_seed_gives_the_same_way(env: NavigationEnv) -> None:
    first, rewards, reached = drive(env, seed=1)
    assert reached
    start, end = (float(np.linalg.norm(seen["goal"])) for seen in (first[0], first[-1]))
    assert end < 0.5
    assert rewards == pytest.approx(start - end + 10, abs=1e-5)
    again, *_ = drive(env, seed=1)
    assert len(again) == len(first)
    for one, other in zip(first, again, strict=True):
        for name, values in one.items():
            np.testing.assert_array_equal(values, other[name], strict=True)
    goals = {tuple(env.reset(seed=seed)[1]["goal_m"]) for seed in range(8)}
    assert goals == set(GOALS)


def test_an_episode_that_does_not_reach_the_goal_is_cut_off(env: NavigationEnv) -> None:
    env.reset(seed=0)
    ends = [env.step(np.zeros(2, np.float32))[2:4] for _ in range(60)]
    assert ends[-1] == (False, True)
    assert set(ends[:-1]) == {(False, False)}


def test_several_run_side_by_side(tmp_path: Path) -> None:
    file = scenario(tmp_path)
    envs = SyncVectorEnv([lambda: NavigationEnv(file, goals_m=GOALS) for _ in range(2)])
    try:
        observed, _ = envs.reset(seed=5)
        assert observed["goal"].shape == (2, 2)
        observed, *_ = envs.step(np.array([[1.0, 0.0], [0.0, 0.0]], np.float32))
        for _ in range(5):
            observed, *_ = envs.step(np.array([[1.0, 0.0], [0.0, 0.0]], np.float32))
        assert observed["velocity"][0, 0] > 0.2 > abs(observed["velocity"][1, 0])
    finally:
        envs.close()


@pytest.fixture
def _no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail if a run is started."""
    monkeypatch.setattr(navigation_env, "SteppedRun", None)


@pytest.mark.usefixtures("_no_process")
@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"goals_m": None}, "no goals. Fix: pass `goals_m`"),
        ({"goals_m": [(1.0, 2.0, 3.0)]}, "goals_m: expected pairs of x and y in meters"),
        ({"goals_m": [(1.0, float("nan"))]}, "goals_m: expected pairs of x and y in meters"),
        ({"vehicle": "car"}, "no vehicle `car`; expected one of"),
        ({"scan": "imu"}, "`rover/imu` is no sensor of kind `lidar_2d`"),
        ({"scan": "radar"}, "`rover/radar` is no sensor of kind `lidar_2d`"),
        ({"period_s": 0.013}, r"step: 0\.013 s is no multiple of 0\.01 s"),
        ({"period_s": float("inf")}, "step: inf s is no multiple"),
        ({"max_steps": 0}, "max_steps 0, reach_m 0.5: expected more than 0"),
        ({"reach_m": float("nan")}, "reach_m nan: expected more than 0"),
    ],
)
def test_mistakes_are_named_before_a_process_starts(
    tmp_path: Path, changes: dict[str, Any], problem: str
) -> None:
    with pytest.raises(UserError, match=problem):
        NavigationEnv(scenario(tmp_path), **({"goals_m": GOALS} | changes))


@pytest.mark.usefixtures("_no_process")
def test_vehicle_with_a_route_is_refused() -> None:
    with pytest.raises(UserError, match=r"drives a route\. Fix: delete `route`"):
        NavigationEnv("indoor_2d", goals_m=GOALS)
