# SPDX-License-Identifier: Apache-2.0
"""Things outdoors in scenario files: put on the ground, and sown where there is room."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from groundlink.loader import load
from groundlink.loader.document import ScenarioError
from groundlink.loader.scatter import SPAWN_CLEARANCE_M
from groundlink.scenario import Scenario
from groundlink.scene.build import solids, world_hash
from groundlink.world.objects.outdoor_specs import Bush, House
from groundlink.world.terrain import Ground, load_ground

WORLD: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("meadow.yaml").read_text())
(HOUSE, _), (BUSHES,) = WORLD["outdoors"], WORLD["scatter"]


def made(folder: Path, seed: int = 1, **changes: object) -> Path:
    """Write a scenario with a vehicle on the grass."""
    vehicle = {"name": "rover", "model": "rover", "placement": {"x_m": 20.0, "y_m": -25.0}}
    scenario = {"name": "it", "seed": seed, "world": WORLD | changes, "vehicles": [vehicle]}
    (folder / "it.yaml").write_text(yaml.safe_dump(scenario))
    return folder / "it.yaml"


def sown(scenario: Scenario) -> list[Bush]:
    return [thing for thing in scenario.world.outdoors if isinstance(thing, Bush)]


def ground_of(scenario: Scenario) -> Ground:
    assert scenario.world.terrain
    return load_ground(scenario.world.terrain)


def test_the_seed_sows(tmp_path: Path) -> None:
    first = load(made(tmp_path))
    assert len(sown(first)) == 120
    assert world_hash(load(made(tmp_path))) == world_hash(first)
    other = load(made(tmp_path, seed=2))
    assert world_hash(other) != world_hash(first)
    assert other.world.outdoors[:2] == first.world.outdoors[:2]
    # What one line sows does not move what others do.
    one, two = (load(made(tmp_path, scatter=[BUSHES | {"count": n}, BUSHES])) for n in (1, 2))
    assert sown(one)[:1] == sown(two)[:1] == sown(first)[:1]
    moved = set(sown(one)[1:]) ^ set(sown(two)[2:])
    assert len(moved) <= 2


def test_what_is_sown_keeps_off_all_else(tmp_path: Path) -> None:
    scenario = load(made(tmp_path))
    here = ground_of(scenario)
    places = np.array([bush.at_m for bush in sown(scenario)])
    for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        rim = places + 1.4 * np.array([np.cos(angle), np.sin(angle)])
        assert {here.materials[n] for n in here.material_at(*rim.T)} == {"grass"}
    apart = np.linalg.norm(places[:, None] - places, axis=-1) + 1e9 * np.eye(len(places))
    assert apart.min() >= 1.5
    assert np.abs(places - (20.0, -25.0)).max(axis=1).min() >= SPAWN_CLEARANCE_M
    house = scenario.world.outdoors[0]
    assert isinstance(house, House)
    assert np.linalg.norm(places - house.at_m, axis=1).min() > 4 + 1.5
    assert np.ptp(places, axis=0).min() > 60
    heights = [bush.height_m for bush in sown(scenario)]
    assert 0.5 <= min(heights) < 0.7 < 1.3 < max(heights) <= 1.5


def test_things_outdoors_stand_on_the_terrain(tmp_path: Path) -> None:
    high = HOUSE | {"at_m": [-20.0, -25.0], "z_m": 50.0}
    scenario = load(made(tmp_path, outdoors=[*WORLD["outdoors"], high]))
    here = ground_of(scenario)
    house, fence, told = scenario.world.outdoors[:3]
    for thing in (house, *sown(scenario)):
        heights = here.height_at(*zip(*thing.feet(), strict=True))
        assert thing.z_m == pytest.approx(heights.min(), abs=1e-3)
    heights = here.height_at(*zip(*fence.feet(), strict=True))
    np.testing.assert_allclose(fence.ground_m, heights, atol=1e-3)
    assert told.z_m == 50.0
    names = {solid.name for solid in solids(scenario)}
    assert {"house_0_walls", "fence_1_post_10", "house_2_door", "bush_3_ball_0"} <= names


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"scatter": [BUSHES | {"count": 2000}]}, r"`scatter`: free space for \d+ of 2000 objects"),
        ({"scatter": [BUSHES | {"ground": ["lava"]}]}, "free space for 0 of 120"),
        ({"scatter": [BUSHES | {"like": {"kind": "shrub"}}]}, "unknown kind `shrub`"),
        ({"scatter": [BUSHES | {"clear": 1}]}, "unknown key `scatter.*clear`"),
        ({"terrain": None}, "`scatter`: expected terrain"),
        ({"outdoors": [HOUSE | {"at_m": [90, 0]}]}, "outside the terrain"),
        ({"outdoors": [HOUSE | {"color": "red"}]}, "unknown key `outdoors.*color`"),
        ({"outdoors": [HOUSE | {"roof_material": "bricks"}]}, "no material `bricks`"),
    ],
)
def test_mistakes_are_one_line(tmp_path: Path, changes: dict[str, object], problem: str) -> None:
    with pytest.raises(ScenarioError, match=problem) as caught:
        load(made(tmp_path, **changes))
    assert "it.yaml:" in str(caught.value)
    assert "\n" not in str(caught.value)
