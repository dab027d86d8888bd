# SPDX-License-Identifier: Apache-2.0
"""The definition of a ROS 2 type as MCAP files and Foxglove's protocol carry it.

Rule: the type's own fields, then those of every type that it is made of, each under a line of its
own (encoding `ros2msg`); taken from the one store of types in `groundlink.ros.types`.
"""

from __future__ import annotations

from functools import cache

from .types import STORE

ENCODING = "ros2msg"
"""Of the definition."""

MESSAGE_ENCODING = "cdr"
"""Of the messages that it describes."""


@cache
def definition(ros_type: str) -> str:
    """Return the full definition of a type such as `sensor_msgs/msg/Imu`."""
    text, _ = STORE.generate_msgdef(ros_type, ros_version=2)
    return text
