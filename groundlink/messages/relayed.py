# SPDX-License-Identifier: Apache-2.0
"""Relayed message: a message of a vehicle's stack that the bus carries as ROS CDR.

`groundlink.ros.cdr` checks that the CDR is a valid message of its type.
"""

from .base import BusMessage


class Relayed(BusMessage, frozen=True):
    """A ROS 2 message, unchanged."""

    stamp_nanos: int
    """Run time of its arrival. The stamp of its publisher is in the message."""

    ros_type: str
    """ROS type, such as nav_msgs/msg/Path."""

    cdr: memoryview
    """CDR with its encapsulation header."""
