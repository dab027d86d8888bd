# SPDX-License-Identifier: Apache-2.0
"""Replies of ROS in lockstep: the newest BarrierReply, and messages that wait for one.

Rule: the link's receiving thread puts in, the main one takes out; nothing is decided here.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

from udp_bridge.receiver.gathering import Gathering
from udp_bridge.wire.lockstep import RESTARTED, WAITING, BarrierReply, SentMessages
from udp_bridge.wire.message import Message


class ReplyMailbox:
    """A letter box between two threads."""

    def __init__(self) -> None:
        self._came = threading.Condition()
        self._is_news = False
        self._gathering = Gathering()
        self._word: tuple[BarrierReply, str] | None = None

    def put(self, message: Message) -> None:
        """Take a message that a BarrierReply will tell of."""
        with self._came:
            self._gathering.put(message)
            self._notify()

    def say(self, word: BarrierReply, topic: str) -> None:
        """Take a BarrierReply and the topic in its header."""
        with self._came:
            if word.state == RESTARTED:
                self._gathering.take_all()  # of a predecessor, whose numbers come again
            self._word = word, topic
            self._notify()

    def wait(self, seconds: float) -> None:
        """Wait until something new is here, or the time is over."""
        with self._came:
            if not self._is_news:
                self._came.wait(seconds)
            self._is_news = False

    def of(self, life: int, tick: int) -> tuple[BarrierReply, str] | None:
        """Return the newest BarrierReply and its topic if it is of this tick."""
        with self._came:
            word = self._word
        return word if word is not None and (word[0].life, word[0].tick) == (life, tick) else None

    def lacking(self, node: str, life: int, tick: int) -> str:
        """Return in a line what a node has not said or done at the barrier of a tick."""
        if tick < 0:
            return f"{node} does not answer; start udp_bridge_ros2 there"
        if (said := self.of(life, tick)) is None:
            return f"{node} has not answered the barrier of tick {tick}"
        word, topic = said
        if word.state == WAITING:
            return f"{node} waits for {topic} since the barrier of tick {tick}"
        if word.state == RESTARTED:
            return f"{node} was started anew and has not got again what was sent to tick {tick}"
        return f"{node} and the gateway lack messages of each other since tick {tick}"

    def missing(self, sent: Sequence[SentMessages]) -> int:
        """Return how many of these messages are still on their way."""
        with self._came:
            return self._gathering.missing(sent)

    def take(self, sent: Sequence[SentMessages]) -> list[Message]:
        """Return those of these messages that are here, in their order."""
        with self._came:
            return self._gathering.take(sent)

    def _notify(self) -> None:
        self._is_news = True
        self._came.notify()
