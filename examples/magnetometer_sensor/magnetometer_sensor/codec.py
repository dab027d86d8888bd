# SPDX-License-Identifier: Apache-2.0
"""Codec: the message as sensor_msgs/MagneticField, and back."""

from typing import Any

import numpy as np

from groundlink.ros.codec import Codec, Moment, stamp_and_frame
from groundlink.ros.types import header, vector, xyz

from .message import MagneticField


def _encode(message: MagneticField) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "magnetic_field": vector(message.field_t),
        "magnetic_field_covariance": np.diag([message.variance_t2] * 3).ravel(),
    }


def _decode(ros: Any, moment: Moment) -> MagneticField:
    variance_t2 = float(ros.magnetic_field_covariance[0])
    return MagneticField(*stamp_and_frame(ros), xyz(ros.magnetic_field), variance_t2)


CODEC = Codec(MagneticField, "sensor_msgs/msg/MagneticField", _encode, _decode)
