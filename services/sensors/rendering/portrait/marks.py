# SPDX-License-Identifier: Apache-2.0
"""Draw frames into a picture: x red, y green, z blue, with their names.

Frames behind surfaces are drawn too, because mounts are often inside a vehicle. Names avoid each
other.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from services.sensors.rendering.gl.pinhole import Pinhole

from .scene import NamedFrame

RED, GREEN, BLUE = (225, 30, 30), (30, 170, 40), (40, 70, 235)
WHITE, BLACK = (255, 255, 255), (0, 0, 0)
FONT = cv2.FONT_HERSHEY_SIMPLEX
TEXT = 0.55
"""Scale of the font."""

BITS = 4
"""Fractional bits of pixel coordinates in OpenCV."""

Rectangle = tuple[int, int, int, int]
"""Left, top, right, bottom."""

Picture = NDArray[np.uint8]
Label = tuple[str, tuple[int, int]]
"""A name, and where the origin of its frame is in the picture."""


def mark(
    picture: Picture,
    frames: Sequence[NamedFrame],
    axis_m: float,
    pinhole: Pinhole,
    world_from_optical: Floats,
) -> None:
    """Draw frames into a picture, shape (height, width, 3), farthest first."""
    optical_from_world = np.linalg.inv(world_from_optical)
    labels: list[Label] = []
    seen = []
    for frame in frames:
        points = frame.ends(axis_m) @ optical_from_world[:3, :3].T + optical_from_world[:3, 3]
        if points[:, 2].min() > pinhole.near_m:
            seen.append((points, frame.name))
    for points, name in sorted(seen, key=lambda each: -each[0][0, 2]):
        pixels = points @ pinhole.matrix().T
        origin, *tips = np.rint((pixels[:, :2] / pixels[:, 2:]) * (1 << BITS)).astype(int).tolist()
        # The axis that points away from the eye is drawn first.
        axes = sorted(zip(points[1:, 2], tips, (RED, GREEN, BLUE), strict=True), reverse=True)
        for color, thickness in ((BLACK, 5), (None, 3)):
            for _, tip, own in axes:
                cv2.line(picture, origin, tip, color or own, thickness, cv2.LINE_AA, BITS)
        labels.append((name, (origin[0] >> BITS, origin[1] >> BITS)))
    _write(picture, labels)


def _meet(one: Rectangle, other: Rectangle) -> bool:
    return all(one[i] < other[i + 2] and other[i] < one[i + 2] for i in (0, 1))


def _write(picture: Picture, labels: Sequence[Label]) -> None:
    """Write names beside their frames, from the top down, without overlap."""
    taken: list[Rectangle] = []
    height, width = picture.shape[:2]
    for name, (x, y) in sorted(labels, key=lambda label: label[1][1]):
        (long, high), below = cv2.getTextSize(name, FONT, TEXT, 1)
        left = min(max(x + 10, 2), width - long - 2)
        top = min(max(y - high - 8, 2), height - high - below - 2)
        while any(_meet((left, top, left + long, top + high + below), other) for other in taken):
            top += 3
        taken.append((left, top, left + long, top + high + below))
        at = (left, top + high)
        if top > y:
            cv2.line(picture, (x, y), (left, top + high // 2), WHITE, 1, cv2.LINE_AA)
        for color, thickness in ((BLACK, 4), (WHITE, 1)):
            cv2.putText(picture, name, at, FONT, TEXT, color, thickness, cv2.LINE_AA)
