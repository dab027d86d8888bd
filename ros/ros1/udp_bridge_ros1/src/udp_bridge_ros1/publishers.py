# SPDX-License-Identifier: Apache-2.0
"""Publishers for the outlet: CDR goes in, ROS 1's bytes go out.

Rule: every subscriber has a queue and a thread of its own in rospy, so one that stalls loses its
own messages and holds up nobody. `seq` counts what was published on a topic, as with any node.
"""

from __future__ import annotations

import itertools
import logging
from struct import Struct
from typing import TYPE_CHECKING

import rospy

from .messages import kind

if TYPE_CHECKING:
    from udp_bridge.header import Buffer
    from udp_bridge.ros_end.deliveries import Delivery
    from udp_bridge.ros_end.outlet import Publish
    from udp_bridge.types import MessageType

_SEQ = Struct("<I")


class Publishers:
    """What an outlet needs of ROS."""

    def get_logger(self) -> logging.Logger:
        """Return rospy's, which the terminal and /rosout hear."""
        return logging.getLogger("rosout")

    def publisher(self, row: MessageType, topic: str, delivery: Delivery) -> Publish:
        """Return how to publish on a topic."""
        raw, plan = kind(str(row.ros_type))
        publisher = rospy.Publisher(
            topic, raw, queue_size=delivery.depth, latch=delivery.is_latched
        )
        counter = itertools.count(1)
        is_description = row.name == "String"

        def publish(body: Buffer) -> None:
            chunks = plan.to_ros1(body)
            if plan.is_stamped:
                chunks[0] = _SEQ.pack(next(counter) & 0xFFFFFFFF)
            if is_description:  # which ROS 1 looks for among the parameters
                text = b"".join(chunks)[_SEQ.size :].decode("utf-8", "replace")
                rospy.set_param(topic, text)
            publisher.publish(raw(*chunks))

        return publish
