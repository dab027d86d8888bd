# SPDX-License-Identifier: Apache-2.0
"""Codecs of images, camera calibrations, laser scans and ranges."""

from typing import Any

import numpy as np

from groundlink.messages.base import packed
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image, LaserScan, Range

from .codec import Codec, Moment, stamp_and_frame
from .types import TYPES, array, float32, header

_RADIATION = {"ultrasound": 0, "infrared": 1}
"""Radiation types of sensor_msgs/Range."""


def _image(message: Image) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "height": message.height,
        "width": message.width,
        "encoding": message.encoding,
        "is_bigendian": 0,
        "step": message.row_bytes,
        "data": array(message.data, np.uint8),
    }


def _image_of(ros: Any, moment: Moment) -> Image:
    return Image(
        *stamp_and_frame(ros), ros.height, ros.width, ros.encoding, ros.step, packed(ros.data)
    )


def _compressed_image(message: CompressedImage) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "format": message.format,
        "data": array(message.data, np.uint8),
    }


def _compressed_image_of(ros: Any, moment: Moment) -> CompressedImage:
    return CompressedImage(*stamp_and_frame(ros), ros.format, packed(ros.data))


def _camera_info(message: CameraInfo) -> dict[str, Any]:
    # Binning and region of interest are not used.
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


def _camera_info_of(ros: Any, moment: Moment) -> CameraInfo:
    return CameraInfo(
        *stamp_and_frame(ros),
        ros.height,
        ros.width,
        ros.distortion_model,
        *(packed(matrix) for matrix in (ros.d, ros.k, ros.r, ros.p)),
    )


def _laser_scan(message: LaserScan) -> dict[str, Any]:
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


def _laser_scan_of(ros: Any, moment: Moment) -> LaserScan:
    return LaserScan(
        *stamp_and_frame(ros),
        ros.angle_min,
        ros.angle_increment,
        ros.time_increment,
        ros.scan_time,
        ros.range_min,
        ros.range_max,
        packed(ros.ranges),
        packed(ros.intensities),
    )


def _range(message: Range) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "radiation_type": _RADIATION[message.radiation],
        "field_of_view": message.field_of_view_rad,
        "min_range": message.min_range_m,
        "max_range": message.max_range_m,
        "range": message.range_m,
        "variance": message.variance_m2,
    }


def _range_of(ros: Any, moment: Moment) -> Range:
    return Range(
        *stamp_and_frame(ros),
        "infrared" if ros.radiation_type else "ultrasound",
        ros.field_of_view,
        ros.min_range,
        ros.max_range,
        ros.range,
        ros.variance,
    )


CODECS = (
    Codec(Image, "sensor_msgs/msg/Image", _image, _image_of),
    Codec(
        CompressedImage,
        "sensor_msgs/msg/CompressedImage",
        _compressed_image,
        _compressed_image_of,
    ),
    Codec(CameraInfo, "sensor_msgs/msg/CameraInfo", _camera_info, _camera_info_of),
    Codec(LaserScan, "sensor_msgs/msg/LaserScan", _laser_scan, _laser_scan_of),
    Codec(Range, "sensor_msgs/msg/Range", _range, _range_of),
)
