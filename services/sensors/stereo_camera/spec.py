# SPDX-License-Identifier: Apache-2.0
"""Specification of a stereo pair in a scenario. The defaults are those of an ideal one."""

from typing import Literal

from groundlink.core.fields import Positive
from groundlink.messages.base import BusMessage
from groundlink.scenario.cameras import JpegQuality, Optics, Publish, info_beside, largest_picture
from groundlink.scenario.every_sensor import Carrier, RosTopic


class StereoCamera(Optics, frozen=True, tag="stereo_camera", kw_only=True):
    """Two rectified cameras side by side that expose at the same time.

    `topic` (such as `/stereo/left/image_raw`), `frame` and the mount are those of the left camera.
    """

    right_topic: RosTopic
    """Image topic of the right camera."""

    baseline_m: Positive
    """Distance from the left camera to the right one."""

    encoding: Literal["rgb8", "bgr8", "mono8"] = "rgb8"
    """Pixel format of both cameras, as in sensor_msgs/Image."""

    publish: Publish = "raw"
    """`compressed`: JPEG under `<topic>/compressed`. `raw`: pixels under `topic`. `both`: both. For
    each of the two cameras."""

    jpeg_quality: JpegQuality = 80
    """Quality of the JPEG; higher values give larger messages with fewer artifacts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if info_beside(self.topic) == info_beside(self.right_topic):
            raise ValueError(
                "`topic` and `right_topic` share a namespace, and so their CameraInfo; expected "
                "such as /stereo/left/image_raw and /stereo/right/image_raw"
            )

    @property
    def color_encoding(self) -> str:
        """Return the encoding of the pictures of both cameras."""
        return self.encoding

    def ros_topics(self) -> dict[str, str]:
        """Return the topics of both cameras, as stereo_image_proc expects them, and of labels."""
        topics = {
            "camera_info": info_beside(self.topic),
            "right_camera_info": info_beside(self.right_topic),
        }
        if self.publish != "compressed":
            topics |= {"": self.topic, "right": self.right_topic}
        if self.publish != "raw":
            topics["compressed"] = f"{self.topic}/compressed"
            topics["right_compressed"] = f"{self.right_topic}/compressed"
        return topics | self.label_topics()

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return a picture of pure noise of one camera."""
        frame = carrier.frame_prefix + self.frame
        return largest_picture(self, frame, self.publish, self.encoding, self.jpeg_quality)
