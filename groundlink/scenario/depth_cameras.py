# SPDX-License-Identifier: Apache-2.0
"""Scenario fields of depth cameras and stereo pairs; the defaults describe ideal devices."""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec
from groundlink.messages.base import POINT, BusMessage, PointCloud
from groundlink.messages.imagery import Image

from .cameras import Optics, jpeg_bytes, largest_picture
from .every_sensor import Carrier, RosTopic

LARGEST_16UC1_M = 65.535
"""Largest depth that 16 bits of millimeters can hold, in meters."""

PNG_BYTES_A_PIXEL = 2.1
"""Bytes per pixel of a PNG of random 16-bit values."""

Publish = Literal["compressed", "raw", "both"]
Quality = Annotated[int, Meta(ge=1, le=100)]


def info_beside(topic: str) -> str:
    """Return the CameraInfo topic that belongs to an image topic, as named by image_transport."""
    return f"{topic.rpartition('/')[0]}/camera_info"


class ColorStream(Spec, frozen=True, kw_only=True):
    """Color stream of a depth camera, registered to depth: same pinhole, pixel for pixel."""

    topic: RosTopic
    publish: Publish = "compressed"
    """`compressed`: JPEG under `<topic>/compressed`. `raw`: rgb8 under `topic`. `both`: both."""

    jpeg_quality: Quality = 80


class DepthCamera(Optics, frozen=True, tag="depth_camera", kw_only=True):
    """A camera that measures each pixel's depth along z; `topic` is its image topic."""

    encoding: Literal["16UC1", "32FC1"] = "16UC1"
    """`16UC1`: millimeters, 0 for no depth. `32FC1`: meters, with NaN and infinities (REP 118)."""

    publish: Publish = "raw"
    """`raw`: pixels under `topic`. `compressed`: PNG under `<topic>/compressedDepth`, in the format
    of image_transport. `both`: both."""

    min_range_m: NonNegative = 0.0
    max_range_m: Positive = 10.0
    baseline_m: NonNegative = 0.0
    """Distance between the two imagers that measure depth, the second one to the right. A point
    that only one of them sees has no depth. 0 for a device without the errors of a stereo pair."""

    disparity_stddev_px: NonNegative = 0.0
    """White noise of the disparity f baseline / z, 1 sigma. The noise of depth is z^2 / (f
    baseline) times this value."""

    edge_holes_px: Annotated[int, Meta(ge=0, le=16)] = 0
    """Pixels within this distance of a disparity jump of more than a pixel have no depth."""

    color: ColorStream | None = None
    points_topic: RosTopic | None = None
    """Topic of the depth as a point cloud; none: no point cloud."""

    points_every: Annotated[int, Meta(ge=1, le=64)] = 1
    """Stride of the point cloud in rows and columns."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"`min_range_m` is {self.min_range_m:g}; expected less than `max_range_m`, "
                f"{self.max_range_m:g}"
            )
        if self.encoding == "16UC1" and self.max_range_m > LARGEST_16UC1_M:
            raise ValueError(
                f"`max_range_m` is {self.max_range_m:g}; expected up to {LARGEST_16UC1_M:g} with "
                "16UC1, or `encoding: 32FC1`"
            )
        if (self.disparity_stddev_px or self.edge_holes_px) and not self.baseline_m:
            raise ValueError(
                "`disparity_stddev_px` and `edge_holes_px` need stereo. Fix: add `baseline_m`"
            )

    def ros_topics(self) -> dict[str, str]:
        """Return the image_transport topics of the images and of the CameraInfo beside each."""
        topics = {"camera_info": info_beside(self.topic)}
        if self.publish != "compressed":
            topics[""] = self.topic
        if self.publish != "raw":
            topics["compressed"] = f"{self.topic}/compressedDepth"
        if self.points_topic:
            topics["points"] = self.points_topic
        if self.color:
            topics["color_info"] = info_beside(self.color.topic)
            if self.color.publish != "raw":
                topics["color"] = f"{self.color.topic}/compressed"
            if self.color.publish != "compressed":
                topics["color_image"] = self.color.topic
        return topics

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return the larger of a cloud with a point for every pixel and an image."""
        pixels, every = self.width * self.height, self.points_every
        sizes = {
            "": pixels * (2 if self.encoding == "16UC1" else 4),
            "compressed": int(pixels * PNG_BYTES_A_PIXEL),
            "points": -(-self.width // every) * -(-self.height // every) * POINT.itemsize,
            "color": jpeg_bytes(pixels, self.color.jpeg_quality) if self.color else 0,
            "color_image": pixels * 3,
            "camera_info": 0,
            "color_info": 0,
        }
        frame = carrier.frame_prefix + self.frame
        largest = max(self.ros_topics(), key=lambda name: sizes[name])
        if largest == "points":
            return PointCloud(0, frame, memoryview(bytes(sizes[largest])))
        row = -(-sizes[largest] // self.height)
        data = memoryview(bytes(row * self.height))
        return Image(0, frame, self.height, self.width, self.encoding, row, data)


class StereoCamera(Optics, frozen=True, tag="stereo_camera", kw_only=True):
    """Two rectified cameras side by side that expose at the same time.

    `topic` (such as `/stereo/left/image_raw`), `frame` and the mount are those of the left camera.
    """

    right_topic: RosTopic
    baseline_m: Positive
    """Distance from the left camera to the right one."""

    encoding: Literal["rgb8", "bgr8", "mono8"] = "rgb8"
    publish: Publish = "raw"
    """`compressed`: JPEG under `<topic>/compressed`. `raw`: pixels under `topic`. `both`: both. For
    each of the two cameras."""

    jpeg_quality: Quality = 80

    def __post_init__(self) -> None:
        super().__post_init__()
        if info_beside(self.topic) == info_beside(self.right_topic):
            raise ValueError(
                "`topic` and `right_topic` share a namespace, and so their CameraInfo; expected "
                "such as /stereo/left/image_raw and /stereo/right/image_raw"
            )

    def ros_topics(self) -> dict[str, str]:
        """Return the topics of both cameras, as stereo_image_proc expects them."""
        topics = {
            "camera_info": info_beside(self.topic),
            "right_camera_info": info_beside(self.right_topic),
        }
        if self.publish != "compressed":
            topics |= {"": self.topic, "right": self.right_topic}
        if self.publish != "raw":
            topics["compressed"] = f"{self.topic}/compressed"
            topics["right_compressed"] = f"{self.right_topic}/compressed"
        return topics

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return a picture of pure noise of one camera."""
        frame = carrier.frame_prefix + self.frame
        return largest_picture(self, frame, self.publish, self.encoding, self.jpeg_quality)
