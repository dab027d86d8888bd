# SPDX-License-Identifier: Apache-2.0
"""Gymnasium environment: drive a vehicle to a goal. Needs the extra `gym`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.bus.topics import sensor_outputs
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.core.frames import matrix_from_quaternion
from groundlink.loader import load
from groundlink.messages.imagery import LaserScan
from groundlink.scenario import Scenario

from .sim_time import as_stepped, check_step
from .stepped_run import SteppedRun

with needs("gym"):
    import gymnasium
    from gymnasium import spaces

Observation = dict[str, Any]

GOAL_REWARD = 10.0
WORLD_SIZE_M = 1e4
MAX_SPEED = 100.0


class NavigationEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A vehicle that has to reach a goal; an episode begins at the scenario's start.

    Observation: `goal`, shape (2,), the goal in the vehicle's frame (x ahead, y left, m);
    `velocity`, shape (2,), forward (m/s) and yaw rate (rad/s), both from ground truth; with `scan`
    also `scan`, shape (rays,), ranges in m, the largest range where nothing was met.
    Action: shape (2,), shares in [-1, 1] of `speed_mps` forward and of `turn_radps` to the left.
    Reward: meters that the vehicle came nearer, and 10 at the goal, which ends the episode.
    The seed of `reset` chooses the goal; everything else is the same in each episode.

    Parameters
    ----------
    scenario
        scenario without a route, or name of a shipped one.
    goals_m
        x and y of the goals in the world; None: the checkpoints of the scenario's world.
    vehicle
        the first one if None.
    scan
        name of the vehicle's 2D LiDAR that is observed.
    period_s
        sim time of a step, a multiple of the clock's period.
    max_steps
        length of an episode.
    reach_m
        distance at which the goal is reached.

    Raises
    ------
    UserError
        before a process starts: when the scenario has no goals, drives by itself, or lacks the
        vehicle or the scan, or a number is impossible.
    """

    def __init__(
        self,
        scenario: str | Path,
        *,
        goals_m: Sequence[tuple[float, float]] | None = None,
        vehicle: str | None = None,
        scan: str | None = None,
        period_s: float = 0.1,
        max_steps: int = 300,
        reach_m: float = 0.5,
        speed_mps: float = 1.0,
        turn_radps: float = 1.0,
    ) -> None:
        given = as_stepped(load(scenario))
        self._vehicle = _checked_vehicle(given, vehicle, scan)
        self._scan_stream = "" if scan is None else f"{self._vehicle}/{scan}"
        self._goals = _checked_goals(given, goals_m)
        if max_steps < 1 or not reach_m > 0.0:
            raise UserError(f"max_steps {max_steps}, reach_m {reach_m:g}: expected more than 0")
        check_step(given, period_s)
        self._sim = SteppedRun(scenario, sensors_together=True)
        self._period_s, self._max_steps, self._reach_m = period_s, max_steps, reach_m
        self._scale = speed_mps, turn_radps
        self._steps, self._goal, self._distance_m = 0, self._goals[0], 0.0
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        observed: dict[str, spaces.Space[Any]] = {
            "goal": spaces.Box(-WORLD_SIZE_M, WORLD_SIZE_M, (2,), np.float32),
            "velocity": spaces.Box(-MAX_SPEED, MAX_SPEED, (2,), np.float32),
        }
        if scan is not None:
            ranges = self._scan()
            observed["scan"] = spaces.Box(0.0, float(ranges.max()), ranges.shape, np.float32)
        self.observation_space = spaces.Dict(observed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see gymnasium.Env."""
        super().reset(seed=seed)
        self._sim.reset()
        self._sim.step(self._period_s)
        self._goal = self._goals[int(self.np_random.integers(len(self._goals)))]
        self._steps = 0
        observation = self._observe()
        self._distance_m = float(np.linalg.norm(observation["goal"]))
        return observation, {"goal_m": self._goal.tolist()}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one period; see gymnasium.Env."""
        forward, left = np.clip(np.asarray(action, np.float64), -1.0, 1.0) * self._scale
        self._sim.command(self._vehicle, forward, left)
        self._sim.step(self._period_s)
        self._steps += 1
        observation = self._observe()
        before, self._distance_m = self._distance_m, float(np.linalg.norm(observation["goal"]))
        is_reached = self._distance_m < self._reach_m
        reward = before - self._distance_m + GOAL_REWARD * is_reached
        return observation, reward, is_reached, self._steps >= self._max_steps, {}

    def close(self) -> None:
        """End the run's processes."""
        self._sim.close()

    def _observe(self) -> Observation:
        truth = self._sim.latest(f"{self._vehicle}/ground_truth")
        base_from_world = matrix_from_quaternion(truth.orientation).T
        away = (*(self._goal - truth.position_m[:2]), 0.0)
        observation = {
            "goal": (base_from_world @ away)[:2].astype(np.float32),
            "velocity": np.array([truth.linear_mps[0], truth.angular_radps[2]], np.float32),
        }
        if self._scan_stream:
            observation["scan"] = self._scan()
        return observation

    def _scan(self) -> NDArray[np.float32]:
        """Return the ranges of the newest scan, clipped to the scanner's limits."""
        while (scan := self._sim.latest(self._scan_stream)) is None:
            self._sim.step()
        ranges = np.frombuffer(scan.ranges_m, np.float32)
        return np.clip(np.nan_to_num(ranges, nan=scan.max_range_m), 0.0, scan.max_range_m).astype(
            np.float32
        )


def _checked_vehicle(scenario: Scenario, vehicle: str | None, scan: str | None) -> str:
    """Return the name of the vehicle that drives."""
    names = [one.name for one in scenario.vehicles]
    if not names or (vehicle is not None and vehicle not in names):
        raise UserError(f"{scenario.name}: no vehicle `{vehicle}`; expected one of {names}")
    chosen = scenario.vehicles[names.index(vehicle) if vehicle else 0]
    if chosen.route is not None:
        raise UserError(f"{scenario.name}: `{chosen.name}` drives a route. Fix: delete `route`")
    if scan is not None:
        found = scenario.sensor(f"{chosen.name}/{scan}")
        outputs = sensor_outputs(found[1]) if found else []
        if not any(output.row.message is LaserScan for output in outputs if not output.name):
            raise UserError(
                f"{scenario.name}: `{chosen.name}/{scan}` is no sensor of kind `lidar_2d`"
            )
    return chosen.name


def _checked_goals(
    scenario: Scenario, goals_m: Sequence[tuple[float, float]] | None
) -> NDArray[np.float64]:
    """Return the goals, shape (N, 2)."""
    found = goals_m or list(scenario.world.checkpoints.values())
    if not found:
        raise UserError(
            f"{scenario.name}: no goals. Fix: pass `goals_m`, or add `checkpoints` to its world"
        )
    if any(len(goal) != 2 or not np.isfinite(goal).all() for goal in found):
        raise UserError(f"goals_m: expected pairs of x and y in meters, got {found}")
    return np.array(found, np.float64)
