# SPDX-License-Identifier: Apache-2.0
"""Stereo camera model: turn states of the world into two pictures of the same instant.

Both eyes have the same K, the same lens and the same direction, so R is the identity. P of the
right eye has Tx = -fx baseline. With an ideal lens the published pictures are already rectified.
Each eye has its own noise. All messages have the left eye's frame, as is usual for stereo pairs in
ROS, and the same stamp.
"""

from groundlink.messages.base import BusMessage
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.labels.picture_labels import PictureLabels
from services.sensors.rendering.cameras.camera_eye import CameraEye
from services.sensors.rendering.cameras.messages import ENCODINGS, camera_info, image, jpeg
from services.sensors.rendering.gl.target import COLOR_ALONE, COLOR_AND_LABELS
from services.sensors.runtime.model import StreamMessage
from services.sensors.runtime.picture_times import PictureModel

from .spec import StereoCamera

LEFT = ("", "compressed", "camera_info")
RIGHT = ("right", "right_compressed", "right_camera_info")
"""Names of each eye's streams: pixels, JPEG, CameraInfo."""


class StereoCameraModel(PictureModel):
    """Stereo camera of a vehicle.

    Raises
    ------
    RenderingUnavailableError
        when OpenGL is missing or can't draw on this machine (a `UserError`).
    UserError
        when the lens cannot be drawn.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: StereoCamera) -> None:
        self._spec = spec
        self._eyes = CameraEye(
            *(scenario, vehicle, spec),
            encoding=spec.encoding,
            layers=COLOR_AND_LABELS if spec.labels else COLOR_ALONE,
            to_the_right_m=(0.0, spec.baseline_m),
        )
        self._labels = PictureLabels(scenario, vehicle, spec, self._eyes) if spec.labels else None
        super().__init__(spec, self._eyes.eye, span_nanos=self._eyes.span_nanos)
        self._frame = vehicle.frame_prefix + spec.frame
        self._outputs = spec.ros_topics().keys()

    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[BusMessage | StreamMessage]:
        """Return the messages of both pictures whose exposure begins at an instant.

        Labels are those of the left one.
        """
        spec, header = self._spec, (stamp_nanos, self._frame)
        made: list[BusMessage | StreamMessage] = []
        left = None
        if self._labels is not None:
            frame = self._eyes.taken(nanos, tick)
            left = frame.color
            made += self._labels.of_picture(frame, nanos, stamp_nanos)
        for eye, ((raw, compressed, info), baseline_m) in enumerate(
            ((LEFT, 0.0), (RIGHT, spec.baseline_m))
        ):
            color = left if left is not None and eye == 0 else None
            if color is None:
                color = self._eyes.read(nanos, tick, eye=eye)
            info_message = camera_info(
                *header, self._eyes.pinhole, spec.lens, baseline_m=baseline_m
            )
            made.append(StreamMessage(info, info_message))
            if raw in self._outputs:
                shown = ENCODINGS[spec.encoding](color)
                pixels = image(*header, spec.encoding, shown)
                made.append(StreamMessage(raw, pixels) if raw else pixels)
            if compressed in self._outputs:
                gray = spec.encoding == "mono8"
                file = jpeg(*header, color, gray=gray, quality=spec.jpeg_quality)
                made.append(StreamMessage(compressed, file))
        return made
