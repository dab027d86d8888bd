# SPDX-License-Identifier: Apache-2.0
"""Camera model: turn states of the world into color or gray pictures with their CameraInfo.

One rendered picture is published in each of its encodings. The stamp is the beginning of the first
row's exposure. The CameraInfo has the same stamp and describes the lens that the picture was drawn
with.
"""

from collections.abc import Iterable

from groundlink.messages.base import BusMessage
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.labels.picture_labels import PictureLabels
from services.sensors.rendering.cameras.camera_eye import CameraEye
from services.sensors.rendering.cameras.messages import ENCODINGS, camera_info, image, jpeg
from services.sensors.rendering.gl.target import COLOR_ALONE, COLOR_AND_LABELS
from services.sensors.runtime.model import StreamMessage
from services.sensors.runtime.picture_times import PictureModel

from .spec import Camera


class CameraModel(PictureModel):
    """Camera of a vehicle.

    Raises
    ------
    RenderingUnavailableError
        when OpenGL is missing or can't draw on this machine (a `UserError`).
    UserError
        when the lens cannot be drawn.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Camera) -> None:
        self._spec = spec
        self._eye = CameraEye(
            *(scenario, vehicle, spec),
            encoding=spec.encoding,
            layers=COLOR_AND_LABELS if spec.labels else COLOR_ALONE,
        )
        self._labels = PictureLabels(scenario, vehicle, spec, self._eye) if spec.labels else None
        super().__init__(spec, self._eye.eye, span_nanos=self._eye.span_nanos)
        self._frame = vehicle.frame_prefix + spec.frame
        self._outputs = spec.ros_topics().keys()

    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[BusMessage | StreamMessage]:
        """Return the messages of the picture whose exposure begins at an instant."""
        spec, header = self._spec, (stamp_nanos, self._frame)
        labels: Iterable[StreamMessage] = ()
        if self._labels is None:
            pixels = self._eye.read(nanos, tick)
        else:
            frame = self._eye.taken(nanos, tick)
            pixels = frame.color
            labels = self._labels.of_picture(frame, nanos, stamp_nanos)
        info_message = camera_info(*header, self._eye.pinhole, spec.lens)
        made: list[BusMessage | StreamMessage] = [StreamMessage("camera_info", info_message)]
        if "image" in self._outputs:
            encoded = ENCODINGS[spec.encoding](pixels)
            made.append(StreamMessage("image", image(*header, spec.encoding, encoded)))
        if "" in self._outputs:
            gray = spec.encoding == "mono8"
            file = jpeg(*header, pixels, gray=gray, quality=spec.jpeg_quality)
            made.append(file)
        return [*made, *labels]
