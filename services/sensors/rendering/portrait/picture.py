# SPDX-License-Identifier: Apache-2.0
"""The portrait of a world, a vehicle or a scenario.

The same files and direction give the same picture, for one version of a driver.
"""

import numpy as np
from numpy.typing import NDArray

from groundlink.loader.partial_scenario import FileKind
from groundlink.scenario.schema import Scenario
from services.sensors.rendering.gl.renderer import Renderer

from .marks import mark
from .scene import scene
from .viewpoint import direction, view

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
    picture = renderer.draw(world_from_optical).color
    mark(picture, shown.frames, shown.axis_m, pinhole, world_from_optical)
    return picture
