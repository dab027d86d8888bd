# SPDX-License-Identifier: Apache-2.0
"""View culling: axis-aligned boxes against the planes of a view.

The result is conservative: a box near a corner of the view may count as visible although it is
outside.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats


@dataclass(frozen=True)
class Boxes:
    """Axis-aligned boxes in the world: centers and half extents, each of shape (N, 3), meters."""

    middles: Floats
    halves: Floats

    @classmethod
    def around(cls, lows: Floats, highs: Floats) -> Self:
        """Return the boxes between pairs of corners, each of shape (N, 3)."""
        return cls((lows + highs) / 2, (highs - lows) / 2)

    def joined(self, others: "Boxes") -> "Boxes":
        """Return these boxes followed by others."""
        return Boxes(
            np.vstack([self.middles, others.middles]), np.vstack([self.halves, others.halves])
        )

    def picked(self, numbers: NDArray[np.intp]) -> "Boxes":
        """Return the boxes with these indices."""
        return Boxes(self.middles[numbers], self.halves[numbers])

    def away(self, point: Floats) -> Floats:
        """Return the distance of each box from a point, shape (N,); 0 for boxes that contain it."""
        apart = np.maximum(np.abs(self.middles - point) - self.halves, 0)
        distances: Floats = np.linalg.norm(apart, axis=1)
        return distances

    def whole(self) -> "Boxes":
        """Return one box around all boxes; no box for none."""
        if not len(self.middles):
            return self
        low, high = self.middles - self.halves, self.middles + self.halves
        return Boxes.around(low.min(axis=0)[None], high.max(axis=0)[None])

    def corners(self) -> Floats:
        """Return the corners of each box, shape (N, 8, 3)."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return self.middles[:, None] + signs * self.halves[:, None]


def seen(boxes: Boxes, clip_from_world: Floats) -> NDArray[np.bool_]:
    """Return which boxes reach into a view, shape (N,). There is no far plane."""
    x, y, z, w = clip_from_world
    planes = np.stack([w + x, w - x, w + y, w - y, w + z])
    normals, offsets = planes[:, :3], planes[:, 3]
    reach = boxes.middles @ normals.T + boxes.halves @ np.abs(normals).T + offsets
    inside: NDArray[np.bool_] = np.all(reach >= 0, axis=1)
    return inside


def from_near_to_far(boxes: Boxes, shown: NDArray[np.bool_], eye: Floats) -> list[int]:
    """Return the indices of the visible boxes, nearest first: near boxes hide others."""
    numbers = np.flatnonzero(shown)
    nearest_first = np.argsort(boxes.picked(numbers).away(eye), kind="stable")
    order: list[int] = numbers[nearest_first].tolist()
    return order
