# SPDX-License-Identifier: Apache-2.0
"""Publishers for the outlet: CDR goes in, ROS 1's bytes go out.

Rule: every subscriber has a queue and a thread of its own in rospy, so one that stalls loses its
own messages and holds up nobody. `seq` counts what was published on a topic, as with any node.
"""

from __future__ import annotations

import io
import itertools
import logging
from importlib import import_module
from struct import Struct
from typing import TYPE_CHECKING, Sequence

import rospy

from udp_bridge.ros_end.options import prefix_frames

from .messages import kind

if TYPE_CHECKING:
    from udp_bridge.header import Buffer
    from udp_bridge.ros_end.deliveries import Delivery
    from udp_bridge.ros_end.outlet import Publish
    from udp_bridge.types import MessageType

_SEQ = Struct("<I")


class Publishers:
    """What an outlet needs of ROS; with a prefix for frames, messages are taken apart for it."""

    def __init__(self, frame_prefix: str = "") -> None:
        self._frame_prefix = frame_prefix

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
            if self._frame_prefix:
                chunks = [self._prefixed(row, chunks)]
            if is_description:  # which ROS 1 looks for among the parameters
                text = b"".join(chunks)[_SEQ.size :].decode("utf-8", "replace")
                rospy.set_param(topic, text)
            publisher.publish(raw(*chunks))

        return publish

    def _prefixed(self, row: MessageType, chunks: Sequence[Buffer]) -> bytes:
        package, _, name = str(row.ros_type).split("/")
        message = getattr(import_module(f"{package}.msg"), name)()
        message.deserialize(b"".join(chunks))
        prefix_frames(message, self._frame_prefix)
        buffer = io.BytesIO()
        message.serialize(buffer)
        return buffer.getvalue()
