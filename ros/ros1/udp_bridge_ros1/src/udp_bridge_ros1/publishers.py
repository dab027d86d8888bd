# SPDX-License-Identifier: Apache-2.0
"""Publishers for ROS 1, which convert CDR to the serialization of ROS 1.

rospy has a queue and a thread for each subscriber. A stalled subscriber loses its own messages,
which are counted, and does not block other subscribers. `seq` counts the messages of a topic, as in
every node.
"""

from __future__ import annotations

import io
import itertools
import logging
from struct import Struct
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Sequence

import rospy

from udp_bridge.node.message_class import message_class
from udp_bridge.node.options import prefix_frames
from udp_bridge.node.publish_queue import Publication

from .messages import raw_type

if TYPE_CHECKING:
    from udp_bridge.node.topic_qos import TopicQos
    from udp_bridge.wire.header import Buffer
    from udp_bridge.wire.types import MessageType

_SEQ = Struct("<I")


class SubscriberQueues:
    """rospy's queues for a topic's subscribers, and counts of dropped messages.

    rospy drops the oldest message of a full queue without notice. A full queue is therefore
    compared before and after publishing: if its last message changed, its first message was
    dropped.
    """

    def __init__(self, publisher: Any, depth: int) -> None:
        self._publisher = publisher
        self._depth = depth
        self._lost: Dict[int, int] = {}

    def publish(self, message: Any) -> None:
        """Publish a message, and count the messages that it displaces."""
        full = [
            (connection.id, queue, queue[-1])
            for connection in self._connections()
            if len(queue := getattr(connection, "_queue", [])) >= self._depth
        ]
        self._publisher.publish(message)
        for number, queue, last in full:
            if queue[-1] is not last:
                self._lost[number] = self._lost.get(number, 0) + 1

    def lost(self) -> Dict[str, int]:
        """Return the number of dropped messages by connected subscriber."""
        names = {connection.id: connection.endpoint_id for connection in self._connections()}
        for number in self._lost.keys() - names.keys():
            del self._lost[number]
        return {names[number]: count for number, count in list(self._lost.items())}

    def _connections(self) -> List[Any]:
        impl = self._publisher.impl
        return list(impl.connections) if impl is not None else []  # None during shutdown


class Ros1Publishers:
    """Factory of publishers. Messages are decoded only to add a frame prefix."""

    def __init__(self, frame_prefix: str = "") -> None:
        self._frame_prefix = frame_prefix
        self._queues: Dict[str, SubscriberQueues] = {}

    def lost(self, topic: str) -> Mapping[str, int]:
        """Return the number of dropped messages of a topic by subscriber."""
        queues = self._queues.get(topic)
        return queues.lost() if queues is not None else {}

    def get_logger(self) -> logging.Logger:
        """Return rospy's logger, which writes to the terminal and /rosout."""
        return logging.getLogger("rosout")

    def publisher(self, row: MessageType, topic: str, qos: TopicQos) -> Publication:
        """Return a publisher of a topic."""
        raw, plan = raw_type(str(row.ros_type))
        publisher = rospy.Publisher(topic, raw, queue_size=qos.depth, latch=qos.is_latched)
        queues = self._queues[topic] = SubscriberQueues(publisher, qos.depth)
        counter = itertools.count(1)
        is_description = row.name == "String"

        def publish(body: Buffer) -> None:
            chunks = plan.to_ros1(body)
            if plan.is_stamped:
                chunks[0] = _SEQ.pack(next(counter) & 0xFFFFFFFF)
            if self._frame_prefix:
                chunks = [self._prefixed(row, chunks)]
            if is_description:  # ROS 1 reads the robot description from a parameter
                text = b"".join(chunks)[_SEQ.size :].decode("utf-8", "replace")
                rospy.set_param(topic, text)
            queues.publish(raw(*chunks))

        def end() -> None:
            self._queues.pop(topic, None)
            publisher.unregister()

        return Publication(publish, end)

    def _prefixed(self, row: MessageType, chunks: Sequence[Buffer]) -> bytes:
        message = message_class(str(row.ros_type))()
        message.deserialize(b"".join(chunks))
        prefix_frames(message, self._frame_prefix)
        buffer = io.BytesIO()
        message.serialize(buffer)
        return buffer.getvalue()
