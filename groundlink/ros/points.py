# SPDX-License-Identifier: Apache-2.0
"""Codecs of point clouds, and of the poses of all bodies.

A cloud is a sensor_msgs/PointCloud2 with the fields of the records, or of a LiDAR's layout; the
poses are a tf2_msgs/TFMessage.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.messages.base import CloudLayout, PointCloud, packed
from groundlink.messages.ground_truth import (
    LABELED_POINT,
    TRUE_POINT,
    WORLD_FRAME,
    Bodies,
    LabeledPoints,
    TruePoints,
)
from groundlink.messages.imagery import RADAR_POINT, RadarDetections

from .cloud_layouts import LAYOUTS
from .codec import Codec, Moment, stamp_and_frame
from .types import TYPES, header, nanos, quaternion, vector, xyz, xyzw

_FIELD_TYPES = {"|u1": 2, "<u2": 4, "<u4": 6, "<f4": 7, "<f8": 8}
"""Types of sensor_msgs/PointField: UINT8, UINT16, UINT32, FLOAT32 and FLOAT64."""

_FIELDS: dict[np.dtype[np.void], list[Any]] = {
    record: [
        TYPES["sensor_msgs/msg/PointField"](
            name=name, offset=offset, datatype=_FIELD_TYPES[record[name].str], count=1
        )
        for name, (_, offset, *_) in (record.fields or {}).items()
    ]
    for record in (
        *(layout.record for layout in LAYOUTS.values()),
        *(TRUE_POINT, LABELED_POINT, RADAR_POINT),
    )
}

_LAYOUT_OF = {
    tuple((one.name, one.offset, one.datatype) for one in _FIELDS[layout.record]): name
    for name, layout in LAYOUTS.items()
}
"""Names of layouts by their fields."""


def layout_of(ros: Any) -> CloudLayout | None:
    """Return the layout of a sensor_msgs/PointCloud2; None if it is none of the known."""
    return _LAYOUT_OF.get(tuple((one.name, one.offset, one.datatype) for one in ros.fields))


def _cloud(message: PointCloud | TruePoints | LabeledPoints | RadarDetections) -> dict[str, Any]:
    return _of_records(message, message.records())


def _point_cloud(message: PointCloud) -> dict[str, Any]:
    layout = LAYOUTS[message.layout]
    return _of_records(message, layout.of(message.records(), message.stamp_nanos))


def _of_records(message: Any, records: NDArray[np.void]) -> dict[str, Any]:
    record, data = records.dtype, records.view(np.uint8)
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
    stamp_nanos, frame = stamp_and_frame(ros)
    name = layout_of(ros)
    if name is None:
        return PointCloud(stamp_nanos, frame, packed(ros.data))
    layout = LAYOUTS[name]
    records = np.frombuffer(ros.data, layout.record)
    return PointCloud(stamp_nanos, frame, packed(layout.points(records, stamp_nanos)), name)


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
    Codec(PointCloud, "sensor_msgs/msg/PointCloud2", _point_cloud, _cloud_of),
    Codec(TruePoints, "sensor_msgs/msg/PointCloud2", _cloud, _true_points_of),
    Codec(LabeledPoints, "sensor_msgs/msg/PointCloud2", _cloud, _labeled_points_of),
    Codec(RadarDetections, "sensor_msgs/msg/PointCloud2", _cloud, _radar_detections_of),
    Codec(Bodies, "tf2_msgs/msg/TFMessage", _bodies, _bodies_of),
)
