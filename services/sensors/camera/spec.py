# SPDX-License-Identifier: Apache-2.0
"""Specification of a camera in a scenario. The defaults are those of an ideal one."""

from typing import Literal

from groundlink.messages.base import BusMessage
from groundlink.scenario.cameras import JpegQuality, Optics, Publish, info_beside, largest_picture
from groundlink.scenario.every_sensor import Carrier


class Camera(Optics, frozen=True, tag="camera", kw_only=True):
    """A color or grayscale camera; `topic` is its image topic as named by image_transport."""

    encoding: Literal["rgb8", "bgr8", "mono8", "bayer_rggb8"] = "rgb8"
    """Pixel format, as in sensor_msgs/Image."""

    publish: Publish = "compressed"
    """`compressed`: JPEG under `<topic>/compressed`. `raw`: pixels under `topic`. `both`: both."""

    jpeg_quality: JpegQuality = 80
    """Quality of the JPEG; higher values give larger messages with fewer artifacts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.encoding.startswith("bayer") and self.publish != "raw":
            raise ValueError("JPEG does not preserve a bayer pattern. Fix: add `publish: raw`")

    @property
    def color_encoding(self) -> str:
        """Return the encoding of the pictures."""
        return self.encoding

    def ros_topics(self) -> dict[str, str]:
        """Return the camera's image_transport topics and the topic of its CameraInfo."""
        topics = {} if self.publish == "raw" else {"": f"{self.topic}/compressed"}
        if self.publish != "compressed":
            topics["image"] = self.topic
        return topics | {"camera_info": info_beside(self.topic)} | self.label_topics()

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return a picture of pure noise."""
        frame = carrier.frame_prefix + self.frame
        return largest_picture(self, frame, self.publish, self.encoding, self.jpeg_quality)
