# SPDX-License-Identifier: Apache-2.0
"""Depth cameras and a world for them."""

from typing import Any

from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from services.sensors.depth_camera.spec import DepthCamera
from tests.services.sensors.yards import box, yard

MOUNT = Mount((0.2, 0.0, 1.0), (0.0, 0.0, 0.0))


def spec(**fields: Any) -> DepthCamera:
    defaults = {"width": 160, "height": 120, "rate_hz": 30.0, "mount": MOUNT}
    return DepthCamera(
        name="depth",
        topic="/camera/depth/image_rect_raw",
        frame="camera_optical_frame",
        **{**defaults, **fields},
    )


def world() -> Scenario:
    """Return a crate in front of a wall, on the ground, under the sky."""
    return yard(
        box("ground", (40, 40, 1), (0, 0, -1.5)),
        box("wall", (1, 12, 2), (8.5, 0, 1.0)),
        box("crate", (1, 1, 1), (4.0, 0.8, 0.9), "black"),
        frame_prefix="one/",
    )
