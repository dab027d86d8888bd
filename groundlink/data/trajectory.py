# SPDX-License-Identifier: Apache-2.0
"""Trajectories: poses over time, read from and written to TUM files.

A line of a TUM file is ``seconds x y z qx qy qz qw``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import matrix_from_quaternion, multiply, nlerp

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """world_from_frame over time."""

    seconds: Array
    """Shape (N,), increasing."""

    positions_m: Array
    """Shape (N, 3)."""

    orientations: Array
    """Shape (N, 4): quaternions xyzw."""

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return float(np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1).sum())

    @property
    def rows(self) -> Array:
        """Shape (N, 8): seconds, x, y, z, qx, qy, qz, qw, as in a TUM file."""
        return np.column_stack((self.seconds, self.positions_m, self.orientations))

    def between(self, first_s: float, last_s: float) -> "Trajectory":
        """Return the part from one time to another."""
        keep = (self.seconds >= first_s) & (self.seconds <= last_s)
        return Trajectory(self.seconds[keep], self.positions_m[keep], self.orientations[keep])

    def at(self, seconds: Array) -> "Trajectory":
        """Return poses at other times: linear in position, normalized linear in rotation.

        Times outside of the trajectory are left out. Between two poses of a truth at 100 Hz the
        rotation is so small that this and slerp are one.
        """
        inside = (seconds >= self.seconds[0]) & (seconds <= self.seconds[-1])
        wanted = seconds[inside]
        after = np.clip(np.searchsorted(self.seconds, wanted), 1, len(self.seconds) - 1)
        t0, t1 = self.seconds[after - 1], self.seconds[after]
        gap = t1 - t0
        share = np.divide(wanted - t0, gap, out=np.zeros_like(wanted), where=gap > 0)
        before = self.positions_m[after - 1]
        positions = before + share[:, None] * (self.positions_m[after] - before)
        turns = nlerp(self.orientations[after - 1], self.orientations[after], share)
        return Trajectory(wanted, positions, turns)

    def seen_from(self, body_from_frame: Sequence[float]) -> "Trajectory":
        """Return world_from_frame where this is world_from_body.

        Parameters
        ----------
        body_from_frame
            x, y, z, qx, qy, qz, qw of a frame that is fixed to the body.
        """
        offset, turn = np.array(body_from_frame[:3]), np.array(body_from_frame[3:])
        positions = self.positions_m + matrix_from_quaternion(self.orientations) @ offset
        return Trajectory(self.seconds, positions, multiply(self.orientations, turn))


def write_tum(file: Path, trajectory: Trajectory) -> None:
    """Write a trajectory."""
    np.savetxt(file, trajectory.rows, fmt=["%.9f"] + 7 * ["%.9g"])


def read_tum(file: Path) -> Trajectory:
    """Read a trajectory.

    Raises
    ------
    UserError
        when the file has no poses.
    """
    rows = np.loadtxt(file, ndmin=2) if file.exists() and file.stat().st_size else np.empty((0, 8))
    if rows.shape[1] != 8 or not len(rows):
        raise UserError(f"{file}: no trajectory; expected lines of `seconds x y z qx qy qz qw`")
    return Trajectory(rows[:, 0], rows[:, 1:4], rows[:, 4:8])
