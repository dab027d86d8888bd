# SPDX-License-Identifier: Apache-2.0
"""The paper's accumulated error: the sum of squared errors at the checkpoints passed so far.

The estimate is aligned at the first pose only, so that errors accumulate.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundlink.core.frames import conjugate, matrix_from_quaternion, multiply
from groundlink.data.trajectory import Trajectory
from groundlink.report.analysis.motion import passages

MM2_PER_M2 = 1e6


@dataclass(frozen=True)
class CheckpointError:
    """The error at a passed checkpoint."""

    checkpoint: str
    seconds: float
    travelled_m: float
    error_m: float
    """Distance between estimated and true position."""

    sum_mm2: float
    """Sum of squared errors so far."""


def aligned_at_start(estimate: Trajectory, truth: Trajectory) -> Trajectory:
    """Return an estimate aligned with the truth at its first pose.

    Poses outside of the truth's time span are dropped.
    """
    true = truth.at(estimate.seconds)
    kept = estimate.between(true.seconds[0], true.seconds[-1])
    turn = multiply(true.orientations[0], conjugate(kept.orientations[0]))
    offsets = kept.positions_m - kept.positions_m[0]
    positions = true.positions_m[0] + offsets @ matrix_from_quaternion(turn).T
    return Trajectory(kept.seconds, positions, multiply(turn, kept.orientations))


def accumulated_errors(
    estimate: Trajectory,
    truth: Trajectory,
    base: Trajectory,
    checkpoints_m: Mapping[str, tuple[float, float]],
) -> list[CheckpointError]:
    """Return each passage of a checkpoint, with the error there and the sum so far.

    Parameters
    ----------
    estimate
        of a sensor's frame, in a world of its own.
    truth
        of the same frame.
    base
        the truth of the vehicle's base, which is what comes by checkpoints.
    checkpoints_m
        x and y by name, in the world.
    """
    fitted = aligned_at_start(estimate, truth)
    track = np.column_stack([base.seconds, base.positions_m])
    ways = np.concatenate([[0.0], np.linalg.norm(np.diff(base.positions_m, axis=0), axis=1)])
    travelled = np.cumsum(ways)
    found: list[CheckpointError] = []
    total = 0.0
    for passage in passages(track, checkpoints_m):
        # At both ends of the drive there may be no estimate.
        instant = np.clip(passage.seconds, fitted.seconds[0], fitted.seconds[-1])
        error = (
            fitted.at(np.array([instant])).positions_m - truth.at(np.array([instant])).positions_m
        )
        error_m = float(np.linalg.norm(error))
        total += error_m**2 * MM2_PER_M2
        way_m = float(np.interp(passage.seconds, base.seconds, travelled))
        found.append(CheckpointError(passage.checkpoint, passage.seconds, way_m, error_m, total))
    return found
