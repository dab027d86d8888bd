# SPDX-License-Identifier: Apache-2.0
"""Codecs of point clouds: sensor_msgs/PointCloud2 with the fields of the records."""

from typing import Any

import numpy as np

from groundlink.messages.base import POINT, PointCloud, packed
from groundlink.messages.ground_truth import TRUE_POINT, TruePoints

from .codec import Codec, Moment, stamp_and_frame
from .types import TYPES, header

_FIELD_TYPES = {"<f4": 7, "<u2": 4, "<u4": 6}
"""Types of sensor_msgs/PointField: FLOAT32, UINT16 and UINT32."""

_FIELDS = {
    record: [
        TYPES["sensor_msgs/msg/PointField"](
            name=name, offset=offset, datatype=_FIELD_TYPES[record[name].str], count=1
        )
        for name, (_, offset, *_) in (record.fields or {}).items()
    ]
    for record in (POINT, TRUE_POINT)
}


def _cloud(message: PointCloud | TruePoints) -> dict[str, Any]:
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


CODECS = (
    Codec(PointCloud, "sensor_msgs/msg/PointCloud2", _cloud, _cloud_of),
    Codec(TruePoints, "sensor_msgs/msg/PointCloud2", _cloud, _true_points_of),
)
