# SPDX-License-Identifier: Apache-2.0
"""What a vehicle's stack tells by ROS and the bus only passes on, for whoever knows its type.

Rule: the message is the CDR that ROS sent, read once to see that it is one (`groundlink.ros.cdr`).
"""

from __future__ import annotations

from .base import BusMessage


class Relayed(BusMessage, frozen=True):
    """A ROS 2 message as it came."""

    stamp_nanos: int
    """The run's time when it came; what its maker stamps is in it."""

    ros_type: str
    """Such as nav_msgs/msg/Path."""

    cdr: memoryview
    """Encapsulation header included."""
