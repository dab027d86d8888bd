# SPDX-License-Identifier: Apache-2.0
"""Direct tests of a LiDAR and an IMU against the ground truth, without a SLAM program.

Sweeps are transformed into the world by the true poses and must lie on its surfaces; a fit yields
the error of stamps, point times and ranges. The IMU is compared with the true motion. Shares no
code with the ray caster.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.estimation.surfaces import distances_m
from groundlink.core.frames import conjugate, matrix_from_quaternion, multiply, rotation_vector
from groundlink.data.trajectory import Trajectory
from groundlink.world.solids import Solid

Floats = NDArray[np.float64]

SWEEPS = 12
"""Those in which the vehicle turns fastest: there an instant shows most."""

POINTS = 600
"""Of each sweep, evenly chosen."""

OUTLIER_M = 0.25
"""A point farther from all surfaces counts as this far: a few strays do not decide a fit."""


SAME_M = 1e-6
"""Mean distances that differ by less are the same."""


@dataclass(frozen=True)
class LidarSweep:
    """A LiDAR sweep."""

    stamp_s: float
    points_m: Floats
    """Shape (N, 3), in the LiDAR's frame."""

    times_s: Floats
    """Shape (N,), from the stamp."""


@dataclass(frozen=True)
class CheckedQuantity:
    """A quantity with an expected value."""

    words: str
    value: float
    expected: float
    tolerance: float

    @property
    def holds(self) -> bool:
        """Whether the value is within its tolerance."""
        return abs(self.value - self.expected) <= self.tolerance


def scan_quantities(
    sweeps: Sequence[LidarSweep], lidar: Trajectory, solids: Sequence[Solid]
) -> list[CheckedQuantity]:
    """Return what sweeps say about themselves, laid on the world's surfaces.

    Parameters
    ----------
    lidar
        the truth of the LiDAR's frame, as the mounts that were told have it.
    """
    chosen = [thinned(sweep) for sweep in fastest_turns(sweeps, lidar)]

    def distances(late_s: float = 0.0, times: float = 1.0, ranges: float = 1.0) -> Floats:
        laid = [
            _laid(LidarSweep(s.stamp_s - late_s, s.points_m * ranges, s.times_s * times), lidar)
            for s in chosen
        ]
        return np.minimum(distances_m(np.concatenate(laid), solids), OUTLIER_M)

    as_told = 1e3 * float(np.mean(distances()))
    late_ms = 1e3 * _least(lambda late_s: distances(late_s=late_s), 0.0, 0.1)
    times = _least(lambda factor: distances(times=factor), 1.0, 1.0)
    ranges = _least(lambda factor: distances(ranges=factor), 1.0, 0.15)
    duration_ms = 1e3 * float(np.median([np.ptp(sweep.times_s) for sweep in sweeps]))
    period_ms = 1e3 * float(np.median(np.diff([sweep.stamp_s for sweep in sweeps])))
    return [
        CheckedQuantity("points to the nearest surface, mean (mm)", as_told, 0.0, 30.0),
        CheckedQuantity("stamps of clouds late by (ms)", late_ms, 0.0, 3.0),
        CheckedQuantity("factor for the times of points that fits best", times, 1.0, 0.05),
        CheckedQuantity(
            "times of a sweep's points, from first to last (ms)", duration_ms, period_ms, 5.0
        ),
        CheckedQuantity("factor for ranges that fits best", ranges, 1.0, 0.01),
    ]


def imu_quantities(
    seconds: Floats, rates_radps: Floats, forces_mps2: Floats, imu: Trajectory
) -> list[CheckedQuantity]:
    """Return what an IMU says about the true motion.

    Parameters
    ----------
    seconds
        shape (N,): stamps.
    rates_radps
        shape (N, 3): angular velocity.
    forces_mps2
        shape (N, 3): linear acceleration, which holds what bears the sensor.
    imu
        the truth of the IMU's frame.
    """

    def slope_and_rest(late_s: float) -> tuple[float, float]:
        inside, true = _true_rates(seconds - late_s, imu)
        told, wanted = rates_radps[inside].ravel(), true.ravel()
        slope = float(told @ wanted / (wanted @ wanted))
        return slope, float(np.mean((told - slope * wanted) ** 2))

    offsets = np.linspace(-0.1, 0.1, 81)
    rests = [slope_and_rest(float(offset))[1] for offset in offsets]
    late_ms = 1e3 * _vertex(offsets, np.array(rests))
    inside = (seconds >= imu.seconds[0]) & (seconds <= imu.seconds[-1])
    turns = matrix_from_quaternion(imu.at(seconds).orientations)
    forces = np.einsum("nij,nj->ni", turns, forces_mps2[inside])
    return [
        CheckedQuantity("turn rates, share of the true ones", slope_and_rest(0.0)[0], 1.0, 0.02),
        CheckedQuantity("stamps of the gyroscope late by (ms)", late_ms, 0.0, 3.0),
        CheckedQuantity("force upwards, mean (m/s2)", float(forces[:, 2].mean()), 9.80665, 0.1),
    ]


def fastest_turns(sweeps: Sequence[LidarSweep], lidar: Trajectory) -> list[LidarSweep]:
    """Return the sweeps during which the LiDAR turns fastest, whole ones within the truth."""
    inside = [s for s in sweeps if lidar.seconds[0] + 0.2 < s.stamp_s < lidar.seconds[-1] - 0.3]
    starts = np.array([s.stamp_s for s in inside])
    before, after = lidar.at(starts), lidar.at(starts + 0.1)
    turned = multiply(conjugate(before.orientations), after.orientations)
    order = np.argsort(-np.linalg.norm(rotation_vector(turned), axis=1), kind="stable")
    return [inside[i] for i in order[:SWEEPS]]


def thinned(sweep: LidarSweep) -> LidarSweep:
    """Return a sweep with at most `POINTS` of its points."""
    kept = np.linspace(0, len(sweep.times_s) - 1, POINTS).astype(np.intp)
    return LidarSweep(sweep.stamp_s, sweep.points_m[kept], sweep.times_s[kept])


def _laid(sweep: LidarSweep, lidar: Trajectory) -> Floats:
    """Return a sweep's points in the world, each from where the LiDAR was at its instant."""
    instants = np.clip(sweep.stamp_s + sweep.times_s, lidar.seconds[0], lidar.seconds[-1])
    poses = lidar.at(instants)
    turned = np.einsum("nij,nj->ni", matrix_from_quaternion(poses.orientations), sweep.points_m)
    laid: Floats = poses.positions_m + turned
    return laid


def _true_rates(seconds: Floats, imu: Trajectory) -> tuple[NDArray[np.bool_], Floats]:
    """Return which times the truth covers, and the turn rates there in the IMU's own frame."""
    step_s = 0.01
    inside = (seconds >= imu.seconds[0] + step_s) & (seconds <= imu.seconds[-1] - step_s)
    before, after = imu.at(seconds[inside] - step_s), imu.at(seconds[inside] + step_s)
    turned = multiply(conjugate(before.orientations), after.orientations)
    return inside, rotation_vector(turned) / (2 * step_s)


def _least(distances: Callable[[float], Floats], about: float, within: float) -> float:
    """Return the argument with the least mean distance: a grid, a finer one, a parabola.

    NaN where they are all the same.
    """
    for width, steps in ((within, 21), (within / 8, 9)):
        grid = np.linspace(about - width, about + width, steps)
        costs = np.array([float(np.mean(distances(float(x)))) for x in grid])
        if np.ptp(costs) < SAME_M:
            return float("nan")
        about = float(grid[costs.argmin()])
    return _vertex(grid, costs)


def _vertex(grid: Floats, costs: Floats) -> float:
    """Return where the parabola through the least of the costs and its neighbors is lowest."""
    i = int(np.clip(costs.argmin(), 1, len(grid) - 2))
    left, middle, right = costs[i - 1 : i + 2]
    bend = left - 2 * middle + right
    shift = 0.0 if bend <= 0 else float(np.clip((left - right) / (2 * bend), -1, 1))
    return float(grid[i] + shift * (grid[1] - grid[0]))
