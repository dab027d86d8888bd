# SPDX-License-Identifier: Apache-2.0
"""Passages of a vehicle at the checkpoints of a world.

Each time a track comes within `NEAR_M` of a checkpoint and leaves again is one passage, at the
moment of the least distance.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NEAR_M = 1.0


@dataclass(frozen=True)
class Passage:
    """One passage of a vehicle."""

    checkpoint: str
    seconds: float
    """Sim time."""

    apart_m: float
    """Horizontal distance from the checkpoint to the vehicle's base."""


def passages(
    track: NDArray[np.float64], checkpoints_m: Mapping[str, tuple[float, float]]
) -> list[Passage]:
    """Return all passages, the earliest first.

    Parameters
    ----------
    track
        Shape (N, 3 or more): time, x, y, as `Motion.track`.
    checkpoints_m
        x and y by name, in the world.
    """
    found = []
    for name, place in checkpoints_m.items():
        apart = np.hypot(*(track[:, 1:3] - place).T)
        near = np.concatenate([[False], apart < NEAR_M, [False]])
        begins, ends = np.flatnonzero(near[1:] != near[:-1]).reshape(-1, 2).T
        for begin, end in zip(begins, ends, strict=True):
            row = begin + int(apart[begin:end].argmin())
            found.append(Passage(name, float(track[row, 0]), float(apart[row])))
    return sorted(found, key=lambda passage: passage.seconds)
