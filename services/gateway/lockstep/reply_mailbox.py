# SPDX-License-Identifier: Apache-2.0
"""Mailbox of the ROS node's messages in lockstep: its newest reply and the messages it lists.

The receive thread of the link puts messages in, the main thread takes them out.
"""

import threading
from collections.abc import Sequence

from udp_bridge.receiver.barrier_buffer import BarrierBuffer
from udp_bridge.wire.lockstep import RESTARTED, WAITING, BarrierReply, SentMessages
from udp_bridge.wire.message import Message


class ReplyMailbox:
    """Newest reply to a barrier, and messages from ROS that a reply will list."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._has_news = False
        self._buffer = BarrierBuffer()
        self._reply: tuple[BarrierReply, str] | None = None

    def put(self, message: Message) -> None:
        """Store a message that a reply will list."""
        with self._changed:
            self._buffer.put(message)
            self._notify()

    def put_reply(self, reply: BarrierReply, topic: str) -> None:
        """Store a reply and the topic in its header."""
        with self._changed:
            if reply.state == RESTARTED:
                self._buffer.take_all()  # sequence numbers of a restarted node begin again
            self._reply = reply, topic
            self._notify()

    def wait(self, seconds: float) -> None:
        """Wait until something was put in, or for a time."""
        with self._changed:
            if not self._has_news:
                self._changed.wait(seconds)
            self._has_news = False

    def of(self, episode: int, tick: int) -> tuple[BarrierReply, str] | None:
        """Return the newest reply and its topic if it answers the barrier of this tick."""
        with self._changed:
            found = self._reply
        return found if found and (found[0].episode, found[0].tick) == (episode, tick) else None

    def lacking(self, node: str, episode: int, tick: int) -> str:
        """Return in a line what a node has not done at the barrier of a tick."""
        if tick < 0:
            return f"{node} does not reply. Fix: start udp_bridge_ros2 there"
        if (found := self.of(episode, tick)) is None:
            return f"{node} has not replied to the barrier of tick {tick}"
        reply, topic = found
        if reply.state == WAITING:
            return f"{node} has been waiting for {topic} since the barrier of tick {tick}"
        if reply.state == RESTARTED:
            return f"{node} was restarted and lacks messages sent up to tick {tick}"
        return f"messages between {node} and the gateway have been missing since tick {tick}"

    def missing(self, sent: Sequence[SentMessages]) -> int:
        """Return how many of these messages have not arrived."""
        with self._changed:
            return self._buffer.missing(sent)

    def take(self, sent: Sequence[SentMessages]) -> list[Message]:
        """Remove and return those of these messages that have arrived, in order."""
        with self._changed:
            return self._buffer.take(sent)

    def _notify(self) -> None:
        self._has_news = True
        self._changed.notify()
