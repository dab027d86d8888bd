# SPDX-License-Identifier: Apache-2.0
"""Codecs of point clouds, and of the poses of all bodies.

A cloud is a sensor_msgs/PointCloud2 with the fields of the records, the poses a tf2_msgs/TFMessage.
"""

from typing import Any

import numpy as np

from groundlink.messages.base import POINT, PointCloud, packed
from groundlink.messages.ground_truth import (
    LABELED_POINT,
    TRUE_POINT,
    WORLD_FRAME,
    Bodies,
    LabeledPoints,
    TruePoints,
)
from groundlink.messages.imagery import RADAR_POINT, RadarDetections

from .codec import Codec, Moment, stamp_and_frame
from .types import TYPES, header, nanos, quaternion, vector, xyz, xyzw

_FIELD_TYPES = {"<f4": 7, "<u2": 4, "<u4": 6}
"""Types of sensor_msgs/PointField: FLOAT32, UINT16 and UINT32."""

_FIELDS = {
    record: [
        TYPES["sensor_msgs/msg/PointField"](
            name=name, offset=offset, datatype=_FIELD_TYPES[record[name].str], count=1
        )
        for name, (_, offset, *_) in (record.fields or {}).items()
    ]
    for record in (POINT, TRUE_POINT, LABELED_POINT, RADAR_POINT)
}


def _cloud(message: PointCloud | TruePoints | LabeledPoints | RadarDetections) -> dict[str, Any]:
    data = np.frombuffer(message.points, np.uint8)
    record = message.records().dtype
    return {
        "header": header(message.stamp_nanos, message.frame),
        "height": 1,
        "width": data.size // record.itemsize,
        "fields": _FIELDS[record],
        "is_bigendian": False,
        "point_step": record.itemsize,
        "row_step": data.size,
        "data": data,
        "is_dense": True,
    }


def _cloud_of(ros: Any, moment: Moment) -> PointCloud:
    return PointCloud(*stamp_and_frame(ros), packed(ros.data))


def _true_points_of(ros: Any, moment: Moment) -> TruePoints:
    return TruePoints(*stamp_and_frame(ros), packed(ros.data))


def _labeled_points_of(ros: Any, moment: Moment) -> LabeledPoints:
    return LabeledPoints(*stamp_and_frame(ros), packed(ros.data))


def _radar_detections_of(ros: Any, moment: Moment) -> RadarDetections:
    return RadarDetections(*stamp_and_frame(ros), packed(ros.data))


def _bodies(message: Bodies) -> dict[str, Any]:
    """Return a transform from the world for each body, in the order of body numbers.

    These transforms are not in the tf tree: their frames are neither a sensor's nor a stack's.
    """
    stamped = TYPES["geometry_msgs/msg/TransformStamped"]
    transform = TYPES["geometry_msgs/msg/Transform"]
    of_all = header(message.stamp_nanos, WORLD_FRAME)
    return {
        "transforms": [
            stamped(
                header=of_all,
                child_frame_id=name,
                transform=transform(translation=vector(pose[:3]), rotation=quaternion(pose[3:])),
            )
            for name, pose in zip(message.names, message.world_from_body().tolist(), strict=True)
        ]
    }


def _bodies_of(ros: Any, moment: Moment) -> Bodies:
    if not ros.transforms:
        raise ValueError("no transforms; expected one for each body")
    poses = [
        (*xyz(one.transform.translation), *xyzw(one.transform.rotation)) for one in ros.transforms
    ]
    return Bodies(
        nanos(ros.transforms[0].header.stamp),
        tuple(one.child_frame_id for one in ros.transforms),
        packed(np.array(poses)),
    )


CODECS = (
    Codec(PointCloud, "sensor_msgs/msg/PointCloud2", _cloud, _cloud_of),
    Codec(TruePoints, "sensor_msgs/msg/PointCloud2", _cloud, _true_points_of),
    Codec(LabeledPoints, "sensor_msgs/msg/PointCloud2", _cloud, _labeled_points_of),
    Codec(RadarDetections, "sensor_msgs/msg/PointCloud2", _cloud, _radar_detections_of),
    Codec(Bodies, "tf2_msgs/msg/TFMessage", _bodies, _bodies_of),
)
