# SPDX-License-Identifier: Apache-2.0
"""How pictures and distances of the bus fill their ROS messages.

Rule: one function a message, from the message to the fields of its ROS type; `ros_messages` has the
table that names them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from groundlink.messages.imagery import CameraInfo, CompressedImage, Image, LaserScan, Range

from .types import TYPES, array, float32, header

_RADIATION = {"ultrasound": 0, "infrared": 1}
"""sensor_msgs/Range's constants."""


def image(message: Image) -> dict[str, Any]:
    """Return the fields of sensor_msgs/Image."""
    return {
        "header": header(message.stamp_nanos, message.frame),
        "height": message.height,
        "width": message.width,
        "encoding": message.encoding,
        "is_bigendian": 0,
        "step": message.row_bytes,
        "data": array(message.data, np.uint8),
    }


def compressed_image(message: CompressedImage) -> dict[str, Any]:
    """Return the fields of sensor_msgs/CompressedImage."""
    return {
        "header": header(message.stamp_nanos, message.frame),
        "format": message.format,
        "data": array(message.data, np.uint8),
    }


def camera_info(message: CameraInfo) -> dict[str, Any]:
    """Return the fields of sensor_msgs/CameraInfo: no binning, no region of interest."""
    region = TYPES["sensor_msgs/msg/RegionOfInterest"]
    return {
        "header": header(message.stamp_nanos, message.frame),
        "height": message.height,
        "width": message.width,
        "distortion_model": message.distortion_model,
        "d": array(message.distortion, np.float64),
        "k": array(message.intrinsic, np.float64),
        "r": array(message.rectification, np.float64),
        "p": array(message.projection, np.float64),
        "binning_x": 0,
        "binning_y": 0,
        "roi": region(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    }


def laser_scan(message: LaserScan) -> dict[str, Any]:
    """Return the fields of sensor_msgs/LaserScan; its last angle follows from its other angles."""
    first, step = float32(message.angle_min_rad), float32(message.angle_increment_rad)
    return {
        "header": header(message.stamp_nanos, message.frame),
        "angle_min": first,
        "angle_max": first + max(0, len(message.ranges_m) // 4 - 1) * step,
        "angle_increment": step,
        "time_increment": message.time_increment_s,
        "scan_time": message.scan_time_s,
        "range_min": message.min_range_m,
        "range_max": message.max_range_m,
        "ranges": array(message.ranges_m, np.float32),
        "intensities": array(message.intensities, np.float32),
    }


def range_reading(message: Range) -> dict[str, Any]:
    """Return the fields of sensor_msgs/Range."""
    return {
        "header": header(message.stamp_nanos, message.frame),
        "radiation_type": _RADIATION[message.radiation],
        "field_of_view": message.field_of_view_rad,
        "min_range": message.min_range_m,
        "max_range": message.max_range_m,
        "range": message.range_m,
        "variance": message.variance_m2,
    }
