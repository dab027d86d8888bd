# SPDX-License-Identifier: Apache-2.0
"""A stereo pair: states of the world in, two pictures of the same instant out.

Rule: rectified as it leaves: both eyes have the same K, no distortion and R of one, and the right
one's P has Tx = -fx baseline. All messages have the left eye's frame, as ROS has it for pairs, and
one stamp.
"""

from __future__ import annotations

import numpy as np

from groundlink.messages import Message
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import StereoCamera
from services.sensors.model import Beside
from services.sensors.pictures import PictureModel
from services.sensors.rendering.eye import Eye
from services.sensors.rendering.messages import ENCODINGS, camera_info, image, jpeg

LEFT = ("", "compressed", "camera_info")
RIGHT = ("right", "right_compressed", "right_camera_info")
"""Names of an eye's streams: pixels, JPEG, CameraInfo."""


class StereoCameraModel(PictureModel):
    """One stereo pair of one vehicle.

    Raises
    ------
    RenderingUnavailableError
        when OpenGL is missing here or does not draw (a `UserError`).
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: StereoCamera) -> None:
        self._spec = spec
        self._eye = Eye(scenario, vehicle, spec)
        super().__init__(spec, self._eye)
        self._frame = vehicle.frame_prefix + spec.frame
        self._outputs = spec.ros_topics().keys()
        self._left_from_right = np.eye(4)
        self._left_from_right[0, 3] = spec.baseline_m

    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[Message | Beside]:
        """Return the messages of both pictures of an instant."""
        spec, header = self._spec, (stamp_nanos, self._frame)
        world_from_left = self._eye.move(nanos)
        made: list[Message | Beside] = []
        for (raw, compressed, info), world_from_optical, baseline_m in (
            (LEFT, world_from_left, 0.0),
            (RIGHT, world_from_left @ self._left_from_right, spec.baseline_m),
        ):
            colour = self._eye.renderer.draw(world_from_optical).colour
            told = camera_info(*header, self._eye.pinhole, baseline_m=baseline_m)
            made.append(Beside(info, told))
            if raw in self._outputs:
                shown = ENCODINGS[spec.encoding](colour)
                pixels = image(*header, spec.encoding, shown)
                made.append(Beside(raw, pixels) if raw else pixels)
            if compressed in self._outputs:
                grey = spec.encoding == "mono8"
                file = jpeg(*header, colour, grey=grey, quality=spec.jpeg_quality)
                made.append(Beside(compressed, file))
        return made
