# SPDX-License-Identifier: Apache-2.0
"""Depth camera model: turn states of the world into depth images with their CameraInfo.

All messages of one picture (depth, color, points) have the same stamp and the same pixels. Depth is
that of the middle of the exposure. The lens distorts depth and color alike; other effects of lens
and image sensor apply to color only. Only outputs that the scenario enables are computed.
"""

from groundlink.messages.base import BusMessage
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import DepthCamera
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.cameras.messages import camera_info, image, jpeg
from services.sensors.runtime.model import StreamMessage
from services.sensors.runtime.picture_times import PictureModel

from .eyes import DepthEye, depth_eye
from .forms import compressed_depth, pixels, points
from .measured import measured


class DepthCameraModel(PictureModel):
    """Depth camera of a vehicle.

    Parameters
    ----------
    eye : DepthEye, optional
        Source of true depth. The default is OpenGL, or ray casting without OpenGL.

    Raises
    ------
    UserError
        when neither OpenGL nor Embree is available, or color is enabled without OpenGL, or the lens
        cannot be drawn.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        spec: DepthCamera,
        *,
        eye: DepthEye | None = None,
    ) -> None:
        self._spec = spec
        self._eye = eye or depth_eye(scenario, vehicle, spec)
        super().__init__(spec, self._eye, span_nanos=self._eye.span_nanos)
        self._frame = vehicle.frame_prefix + spec.frame
        self._outputs = spec.ros_topics().keys()
        self._streams = RandomStreams(scenario.seed, f"{vehicle.name}/{spec.name}")

    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[BusMessage | StreamMessage]:
        """Return the messages of the picture at an instant."""
        spec, outputs, header = self._spec, self._outputs, (stamp_nanos, self._frame)
        truth_m, color = self._eye.look(nanos, tick)
        pinhole = self._eye.pinhole
        depth_m = measured(truth_m, pinhole.fx, spec, self._streams.at("disparity", tick))
        info = camera_info(*header, pinhole, spec.lens)
        made: list[BusMessage | StreamMessage] = [StreamMessage("camera_info", info)]
        if "" in outputs:
            made.append(image(*header, spec.encoding, pixels(depth_m, spec.encoding)))
        if "compressed" in outputs:
            file = compressed_depth(*header, depth_m, spec.encoding, spec.max_range_m)
            made.append(StreamMessage("compressed", file))
        if "points" in outputs:
            slopes = self._eye.slopes
            cloud = points(*header, depth_m, slopes, every=spec.points_every, color=color)
            made.append(StreamMessage("points", cloud))
        if spec.color and color is not None:
            made.append(StreamMessage("color_info", info))
            if "color" in outputs:
                quality = spec.color.jpeg_quality
                made.append(
                    StreamMessage("color", jpeg(*header, color, gray=False, quality=quality))
                )
            if "color_image" in outputs:
                made.append(StreamMessage("color_image", image(*header, "rgb8", color)))
        return made
