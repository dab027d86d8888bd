# SPDX-License-Identifier: Apache-2.0
"""Specification of a depth camera in a scenario. The defaults are those of an ideal one."""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec
from groundlink.messages.base import POINT, BusMessage, PointCloud
from groundlink.messages.imagery import Image
from groundlink.scenario.cameras import JpegQuality, Optics, Publish, info_beside, jpeg_bytes
from groundlink.scenario.every_sensor import Carrier, RosTopic

LARGEST_16UC1_M = 65.535
"""Largest depth that 16 bits of millimeters can hold, in meters."""

PNG_BYTES_A_PIXEL = 2.1
"""Bytes per pixel of a PNG of random 16-bit values."""


class ColorStream(Spec, frozen=True, kw_only=True):
    """Color stream of a depth camera, registered to depth: same pinhole, pixel for pixel."""

    topic: RosTopic
    """ROS topic of the color image."""

    publish: Publish = "compressed"
    """`compressed`: JPEG under `<topic>/compressed`. `raw`: rgb8 under `topic`. `both`: both."""

    jpeg_quality: JpegQuality = 80
    """Quality of the JPEG; higher values give larger messages with fewer artifacts."""


class DepthCamera(Optics, frozen=True, tag="depth_camera", kw_only=True):
    """A camera that measures each pixel's depth along z; `topic` is its image topic."""

    encoding: Literal["16UC1", "32FC1"] = "16UC1"
    """`16UC1`: millimeters, 0 for no depth. `32FC1`: meters, with NaN and infinities (REP 118)."""

    publish: Publish = "raw"
    """`raw`: pixels under `topic`. `compressed`: PNG under `<topic>/compressedDepth`, in the format
    of image_transport. `both`: both."""

    min_range_m: NonNegative = 0.0
    """Smallest depth. Nearer surfaces have none: 0 in 16UC1, minus infinity in 32FC1."""

    max_range_m: Positive = 10.0
    """Largest depth. Farther surfaces have none: 0 in 16UC1, plus infinity in 32FC1."""

    baseline_m: NonNegative = 0.0
    """Distance between the two imagers that measure depth, the second one to the right. A point
    that only one of them sees has no depth. 0 for a device without the errors of a stereo pair."""

    disparity_stddev_px: NonNegative = 0.0
    """White noise of the disparity f baseline / z, 1 sigma. The noise of depth is z^2 / (f
    baseline) times this value."""

    edge_holes_px: Annotated[int, Meta(ge=0, le=16)] = 0
    """Pixels within this distance of a disparity jump of more than a pixel have no depth."""

    color: ColorStream | None = None
    """Color stream beside the depth; none: no color."""

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
        return topics | self.label_topics()

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return the larger of a cloud with a point for every pixel and an image."""
        pixels, every = self.width * self.height, self.points_every
        sizes = {
            "": pixels * (2 if self.encoding == "16UC1" else 4),
            "compressed": int(pixels * PNG_BYTES_A_PIXEL),
            "points": -(-self.width // every) * -(-self.height // every) * POINT.itemsize,
            "color": jpeg_bytes(pixels, self.color.jpeg_quality) if self.color else 0,
            "color_image": pixels * 3,
            "instances": pixels * 2,
        }
        frame = carrier.frame_prefix + self.frame
        largest = max(self.ros_topics(), key=lambda name: sizes.get(name, 0))
        if largest == "points":
            return PointCloud(0, frame, memoryview(bytes(sizes[largest])))
        row = -(-sizes[largest] // self.height)
        data = memoryview(bytes(row * self.height))
        return Image(0, frame, self.height, self.width, self.encoding, row, data)
