# SPDX-License-Identifier: Apache-2.0
"""Messages with pictures and distances: cameras, planar scanners, range finders and radars.

They have the fields of the ROS types, with units in the names. Values that follow from other
fields, such as the last angle of a scan, are left out. The encoding field defines the pixels; this
module does not interpret them.
"""

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from .base import Reading, exactly, whole

RADAR_POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "velocity", "rcs", "snr")])
"""A radar detection in the layout of sensor_msgs/PointCloud2: position in meters in the sensor's
frame, radial velocity in m/s (positive: the distance grows), radar cross-section in dBsm,
signal-to-noise ratio in dB."""

Uint32 = Annotated[int, Meta(ge=0, le=2**32 - 1)]


class Image(Reading, frozen=True):
    """An uncompressed image of a camera (sensor_msgs/Image)."""

    stamp_nanos: int
    """Start of the exposure."""

    frame: str
    """Optical frame: x right, y down, z forward."""

    height: Uint32
    width: Uint32
    encoding: str
    """As in sensor_msgs/image_encodings.hpp: `rgb8`, `mono8`, `32FC1`; little-endian."""

    row_bytes: Uint32
    data: memoryview
    """`height` rows of `row_bytes` bytes each."""

    def __post_init__(self) -> None:
        exactly(self.data, self.height * self.row_bytes, "data")


class CompressedImage(Reading, frozen=True):
    """A compressed image of a camera (sensor_msgs/CompressedImage)."""

    stamp_nanos: int
    frame: str
    """Optical frame: x right, y down, z forward."""

    format: str
    """`jpeg` or `png`, or in the form of image_transport: `rgb8; jpeg compressed bgr8`."""

    data: memoryview
    """The compressed file."""


class CameraInfo(Reading, frozen=True):
    """Calibration of a camera at full resolution (sensor_msgs/CameraInfo)."""

    stamp_nanos: int
    """Stamp of the image that the calibration belongs to."""

    frame: str
    height: Uint32
    width: Uint32
    distortion_model: str
    """`plumb_bob`, `rational_polynomial` or `equidistant`."""

    distortion: memoryview
    """D: float64, the coefficients of the distortion model."""

    intrinsic: memoryview
    """K: float64, 3 x 3, row-major, in pixels."""

    rectification: memoryview
    """R: float64, 3 x 3, row-major."""

    projection: memoryview
    """P: float64, 3 x 4, row-major, in pixels."""

    def __post_init__(self) -> None:
        whole(self.distortion, 8, "distortion")
        exactly(self.intrinsic, 9 * 8, "intrinsic")
        exactly(self.rectification, 9 * 8, "rectification")
        exactly(self.projection, 12 * 8, "projection")


class LaserScan(Reading, frozen=True):
    """A sweep of a planar laser scanner (sensor_msgs/LaserScan)."""

    stamp_nanos: int
    """Time of the first ray."""

    frame: str
    """Sensor frame. Angles are about its z axis, counterclockwise from x."""

    angle_min_rad: float
    angle_increment_rad: float
    """Angle between rays, in order of time; negative if the head turns clockwise."""

    time_increment_s: float
    """Time between two rays."""

    scan_time_s: float
    """Time between two scans."""

    min_range_m: float
    max_range_m: float
    ranges_m: memoryview
    """float32, one value per ray; -inf below the smallest range, +inf without a return (REP 117).
    """

    intensities: memoryview
    """float32, one value per ray, or empty."""

    def __post_init__(self) -> None:
        whole(self.ranges_m, 4, "ranges_m")
        if len(self.intensities):
            exactly(self.intensities, len(self.ranges_m), "intensities")


class Range(Reading, frozen=True):
    """A distance measured by an ultrasonic or infrared range finder (sensor_msgs/Range)."""

    stamp_nanos: int
    frame: str
    """Sensor frame. The beam points along its x axis."""

    radiation: Literal["ultrasound", "infrared"]
    field_of_view_rad: float
    """Full angle of the cone in which the distance was measured."""

    min_range_m: float
    max_range_m: float
    range_m: float
    """-inf below the smallest range, +inf without a return, NaN for a failed measurement (REP 117).
    """

    variance_m2: float
    """Variance; 0 if unknown."""


class RadarDetections(Reading, frozen=True):
    """Detections of one frame of a radar, in no particular order (sensor_msgs/PointCloud2)."""

    stamp_nanos: int
    frame: str
    """Sensor frame: x along the axis of the antenna, z up."""

    points: memoryview
    """`RADAR_POINT` records."""

    def __post_init__(self) -> None:
        whole(self.points, RADAR_POINT.itemsize, "points")

    def records(self) -> NDArray[np.void]:
        """Return the detections as a structured array, shape (N,), dtype `RADAR_POINT`."""
        return np.frombuffer(self.points, RADAR_POINT)
