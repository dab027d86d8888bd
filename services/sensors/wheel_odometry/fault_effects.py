# SPDX-License-Identifier: Apache-2.0
"""Fault effects on wheel odometry."""

import math

from msgspec.structs import replace

from groundlink.messages.navigation import Odometry
from services.sensors.faults.offsets import Offsets


def offset_yaw(odometry: Odometry, offsets: Offsets) -> Odometry:
    """Turn the pose about the frame's z."""
    half = float(offsets(1, 1)[0, 0]) / 2
    s, c = math.sin(half), math.cos(half)
    x, y, z, w = odometry.orientation
    turned = (c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z)
    return replace(odometry, orientation=turned)
