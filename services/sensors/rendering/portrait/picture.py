# SPDX-License-Identifier: Apache-2.0
"""The portrait of a world, a vehicle or a scenario, from the nearest point that sees all of it.

The same files and direction give the same picture, for one version of a driver.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.loader.partial_scenario import FileKind
from groundlink.scenario.schema import Scenario
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer

from .scene import NamedFrame, scene

INDOORS = 1.5
"""Exposure in rooms, whose corners are dark."""

SAMPLES = 16
"""Samples per pixel, for smooth edges."""


def portrait(
    kind: FileKind, scenario: Scenario, from_deg: tuple[float, float], size: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return a picture, shape (height, width, 3): red, green, blue.

    Parameters
    ----------
    from_deg
        Direction of the eye: clockwise from north, and elevation.
    size
        Width and height, pixels.

    Raises
    ------
    RenderingUnavailableError
        If OpenGL is missing or does not draw (a `UserError`).
    """
    towards_eye = direction(*from_deg)
    shown = scene(kind, scenario, towards_eye)
    pinhole, world_from_optical = view(shown.corners, towards_eye, *size)
    renderer = Renderer(shown.world, shown, pinhole, layers=["color"], samples=SAMPLES)
    renderer.place(shown.poses)
    if shown.world.room:
        renderer.exposure = INDOORS
    picture = renderer.draw(world_from_optical).color.copy()
    mark(picture, shown.frames, shown.axis_m, pinhole, world_from_optical)
    return picture


FIELD_DEG = 34.0
"""Vertical field of view in degrees. It is narrow, so that near objects don't look too large."""

MARGIN = 0.90
"""Largest share of the picture's width and height that is filled."""

NEAR = 0.02
"""Near end of the view, as a share of the distance."""


def direction(azimuth_deg: float, elevation_deg: float) -> Floats:
    """Return the unit vector, shape (3,), of an azimuth clockwise from north and an elevation."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return np.array([level * math.sin(azimuth), level * math.cos(azimuth), math.sin(elevation)])


def view(points: Floats, towards_eye: Floats, width: int, height: int) -> tuple[Pinhole, Floats]:
    """Return a camera that sees all points, and its world_from_optical, shape (4, 4)."""
    focal = height / 2 / math.tan(math.radians(FIELD_DEG) / 2)
    helper = np.array([0.0, 0.0, 1.0]) if abs(towards_eye[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(helper, towards_eye)
    right /= np.linalg.norm(right)
    world_from_optical = np.eye(4)
    world_from_optical[:3, :3] = np.stack(
        [right, np.cross(-towards_eye, right), -towards_eye], axis=-1
    )
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, z = ((points - middle) @ world_from_optical[:3, :3]).T
    shift, away = [], []
    for across, size in ((x, width), (y, height)):
        # The planes at the picture's edges, each through the outermost point.
        slope = MARGIN * size / 2 / focal
        most, least = (across - slope * z).max(), (-across - slope * z).max()
        shift.append((most - least) / 2)
        away.append((most + least) / 2 / slope)
    distance = max(*away, 1e-3 - z.min())
    world_from_optical[:3, 3] = middle + world_from_optical[:3, :3] @ (*shift, -distance)
    pinhole = Pinhole(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    return replace(pinhole, near_m=NEAR * (distance + z.min())), world_from_optical


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
    """Draw frames with their names, farthest first: x red, y green, z blue.

    Frames behind surfaces are drawn too, because mounts are often inside a vehicle. The picture has
    shape (height, width, 3).
    """
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
