# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus that hold pictures and distances: cameras, planar scanners, range finders.

Rule: the fields of the ROS types in the words of the bus, with their units; the same rules as in
`messages`. What follows from other fields (a scan's last angle) is no field. Pixels are as their
encoding says; nothing here looks into them.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from .base import Reading, exactly, whole

Uint32 = Annotated[int, Meta(ge=0, le=2**32 - 1)]


class Image(Reading, frozen=True):
    """An uncompressed image of a camera (sensor_msgs/Image)."""

    stamp_nanos: int
    """When the exposure began."""

    frame: str
    """Optical frame: x right, y down, z forward."""

    height: Uint32
    width: Uint32
    encoding: str
    """As in sensor_msgs/image_encodings.hpp: `rgb8`, `mono8`, `32FC1`; little-endian."""

    row_bytes: Uint32
    data: memoryview
    """`height` rows of `row_bytes` bytes."""

    def __post_init__(self) -> None:
        exactly(self.data, self.height * self.row_bytes, "data")


class CompressedImage(Reading, frozen=True):
    """A compressed image of a camera (sensor_msgs/CompressedImage)."""

    stamp_nanos: int
    frame: str
    """Optical frame: x right, y down, z forward."""

    format: str
    """`jpeg` or `png`, or as image_transport says it: `rgb8; jpeg compressed bgr8`."""

    data: memoryview
    """The compressed file."""


class CameraInfo(Reading, frozen=True):
    """How a camera maps points to pixels (sensor_msgs/CameraInfo), of the full resolution."""

    stamp_nanos: int
    """That of the image that it goes with."""

    frame: str
    height: Uint32
    width: Uint32
    distortion_model: str
    """`plumb_bob`, `rational_polynomial` or `equidistant`."""

    distortion: memoryview
    """D: float64, as many as the model has."""

    intrinsic: memoryview
    """K: float64, 3 x 3, row after row, pixels."""

    rectification: memoryview
    """R: float64, 3 x 3, row after row."""

    projection: memoryview
    """P: float64, 3 x 4, row after row, pixels."""

    def __post_init__(self) -> None:
        whole(self.distortion, 8, "distortion")
        exactly(self.intrinsic, 9 * 8, "intrinsic")
        exactly(self.rectification, 9 * 8, "rectification")
        exactly(self.projection, 12 * 8, "projection")


class LaserScan(Reading, frozen=True):
    """One sweep of a planar laser scanner (sensor_msgs/LaserScan)."""

    stamp_nanos: int
    """The first ray."""

    frame: str
    """Angles are about its z, from x, counter-clockwise."""

    angle_min_rad: float
    angle_increment_rad: float
    """Negative where the head turns clockwise: rays are in the order of time."""

    time_increment_s: float
    """From one ray to the next."""

    scan_time_s: float
    """From one scan to the next."""

    min_range_m: float
    max_range_m: float
    ranges_m: memoryview
    """float32, one a ray; -inf nearer than the least, +inf where nothing came back (REP 117)."""

    intensities: memoryview
    """float32, one a ray, or none at all."""

    def __post_init__(self) -> None:
        whole(self.ranges_m, 4, "ranges_m")
        if len(self.intensities):
            exactly(self.intensities, len(self.ranges_m), "intensities")


class Range(Reading, frozen=True):
    """One distance of an ultrasonic or infrared range finder (sensor_msgs/Range)."""

    stamp_nanos: int
    frame: str
    """The beam leaves along its x."""

    radiation: Literal["ultrasound", "infrared"]
    field_of_view_rad: float
    """Of the cone in which the distance may have been met."""

    min_range_m: float
    max_range_m: float
    range_m: float
    """-inf nearer than the least, +inf for nothing met, NaN for a failed measurement (REP 117)."""

    variance_m2: float
    """0 where it is unknown."""
