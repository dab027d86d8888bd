# SPDX-License-Identifier: Apache-2.0
"""Codecs of images, camera calibrations, laser scans, ranges and labels.

Labels are messages of vision_msgs 4, which no table of ROS types has; their definitions are here.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from groundlink.messages.base import floats, packed
from groundlink.messages.ground_truth import Detections2D, Detections3D, LabelTable
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image, LaserScan, Range

from .codec import Codec, Moment, stamp_and_frame
from .types import TYPES, array, float32, header, pose, vector, xyz, xyzw

_RADIATION = {"ultrasound": 0, "infrared": 1}
"""Radiation types of sensor_msgs/Range."""

_SEPARATOR = "=" * 80

_VISION = {
    "ObjectHypothesis": "string class_id\nfloat64 score",
    "ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose",
    "Point2D": "float64 x\nfloat64 y",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
    "BoundingBox2D bbox\nstring id",
    "Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
    "BoundingBox3D bbox\nstring id",
    "VisionClass": "uint16 class_id\nstring class_name",
}
"""Definitions of the parts of messages, without comments. `ros/vision_msgs` has the files."""


def _definition(fields: str, *parts: str) -> str:
    """Return the definition of a type with those of its parts."""
    texts = (f"MSG: vision_msgs/{part}\n{_VISION[part]}" for part in parts)
    return f"\n{_SEPARATOR}\n".join((fields, *texts))


_HYPOTHESIS = ("ObjectHypothesisWithPose", "ObjectHypothesis")

_LABEL_INFO = _definition(
    "std_msgs/Header header\nvision_msgs/VisionClass[] class_map\nfloat32 threshold", "VisionClass"
)
_DETECTIONS_2D = _definition(
    "std_msgs/Header header\nvision_msgs/Detection2D[] detections",
    *("Detection2D", "BoundingBox2D", "Pose2D", "Point2D", *_HYPOTHESIS),
)
_DETECTIONS_3D = _definition(
    "std_msgs/Header header\nvision_msgs/Detection3D[] detections",
    *("Detection3D", "BoundingBox3D", *_HYPOTHESIS),
)


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


def _label_table(message: LabelTable) -> dict[str, Any]:
    number = TYPES["vision_msgs/msg/VisionClass"]
    numbers = array(message.numbers, np.uint16).tolist()
    return {
        "header": header(message.stamp_nanos, message.frame),
        "class_map": [
            number(class_id=number_of, class_name=name)
            for number_of, name in zip(numbers, message.names, strict=True)
        ],
        "threshold": 0.0,
    }


def _label_table_of(ros: Any, moment: Moment) -> LabelTable:
    numbers = np.array([one.class_id for one in ros.class_map], np.uint16)
    names = tuple(one.class_name for one in ros.class_map)
    return LabelTable(*stamp_and_frame(ros), names, packed(numbers))


def _detections_2d(message: Detections2D) -> dict[str, Any]:
    point, center, box = (
        TYPES[f"vision_msgs/msg/{name}"] for name in ("Point2D", "Pose2D", "BoundingBox2D")
    )
    boxes = (
        box(center=center(position=point(x=x, y=y), theta=0.0), size_x=width, size_y=height)
        for x, y, width, height in floats(message.boxes_px).reshape(-1, 4).tolist()
    )
    return _detections(message, "Detection2D", boxes)


def _detections_2d_of(ros: Any, moment: Moment) -> Detections2D:
    boxes = [
        (one.center.position.x, one.center.position.y, one.size_x, one.size_y)
        for one in (found.bbox for found in ros.detections)
    ]
    return Detections2D(*_objects_of(ros), packed(np.array(boxes, np.float64)))


def _detections_3d(message: Detections3D) -> dict[str, Any]:
    box = TYPES["vision_msgs/msg/BoundingBox3D"]
    boxes = (
        box(center=pose((x, y, z), (qx, qy, qz, qw)), size=vector((length, width, height)))
        for x, y, z, qx, qy, qz, qw, length, width, height in floats(message.boxes)
        .reshape(-1, 10)
        .tolist()
    )
    return _detections(message, "Detection3D", boxes)


def _detections_3d_of(ros: Any, moment: Moment) -> Detections3D:
    boxes = [
        (*xyz(one.center.position), *xyzw(one.center.orientation), *xyz(one.size))
        for one in (found.bbox for found in ros.detections)
    ]
    return Detections3D(*_objects_of(ros), packed(np.array(boxes, np.float64)))


def _detections(
    message: Detections2D | Detections3D, kind: str, boxes: Iterator[Any]
) -> dict[str, Any]:
    """Return the fields of an array of detections, one for each object and box.

    A detection has one hypothesis; its pose is that of the box, or zero for a box in a picture.
    """
    detection, hypothesis, with_pose = (
        TYPES[f"vision_msgs/msg/{name}"]
        for name in (kind, "ObjectHypothesis", "ObjectHypothesisWithPose")
    )
    covariant = TYPES["geometry_msgs/msg/PoseWithCovariance"]
    nowhere = pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    exact = np.zeros(36)
    of_all = header(message.stamp_nanos, message.frame)
    of_objects = zip(
        message.names,
        array(message.classes, np.uint16).tolist(),
        floats(message.visible).tolist(),
        boxes,
        strict=True,
    )
    return {
        "header": of_all,
        "detections": [
            detection(
                header=of_all,
                results=[
                    with_pose(
                        hypothesis=hypothesis(class_id=str(number), score=score),
                        pose=covariant(
                            pose=box.center if kind == "Detection3D" else nowhere, covariance=exact
                        ),
                    )
                ],
                bbox=box,
                id=name,
            )
            for name, number, score, box in of_objects
        ],
    }


def _objects_of(ros: Any) -> tuple[int, str, tuple[str, ...], memoryview, memoryview]:
    """Return stamp, frame, names, classes and visible shares of an array of detections."""
    best = [one.results[0].hypothesis for one in ros.detections]
    classes = np.array([int(one.class_id) for one in best], np.uint16)
    visible = np.array([one.score for one in best], np.float64)
    names = tuple(one.id for one in ros.detections)
    return *stamp_and_frame(ros), names, packed(classes), packed(visible)


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
    Codec(
        *(LabelTable, "vision_msgs/msg/LabelInfo", _label_table, _label_table_of),
        definition=_LABEL_INFO,
    ),
    Codec(
        *(Detections2D, "vision_msgs/msg/Detection2DArray", _detections_2d, _detections_2d_of),
        definition=_DETECTIONS_2D,
    ),
    Codec(
        *(Detections3D, "vision_msgs/msg/Detection3DArray", _detections_3d, _detections_3d_of),
        definition=_DETECTIONS_3D,
    ),
)
