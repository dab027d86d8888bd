# SPDX-License-Identifier: Apache-2.0
"""Datagrams in, whole messages out: the receiving rules of PROTOCOL.md.

Whatever arrives, nothing is raised: a bad datagram is counted by reason and changes nothing
else. Time is an argument, a sender is anything hashable, and no reference to a datagram's
buffer is kept. Not here: bounds (`holdings`), sockets, credits, and who may send at all.
"""

from __future__ import annotations

from typing import Hashable, Iterator, Optional, Tuple

from . import control
from .assembly import Assembly
from .counters import Counters
from .header import Buffer, Header, Refused, parse
from .holdings import Holdings, Limits, Topic
from .message import Message
from .ordering import key_of
from .types import CONTROL


class Reassembler:
    """Joins datagrams of any number of senders into messages.

    Call `receive` for every datagram, and `expire` now and then while none comes.
    """

    def __init__(self, limits: Optional[Limits] = None) -> None:
        self.limits = limits if limits is not None else Limits()
        self.counters = Counters()
        self._holdings = Holdings(self.limits, self.counters)

    @property
    def memory_bytes(self) -> int:
        """Announced size of all open messages."""
        return self._holdings.memory_bytes

    def receive(self, datagram: Buffer, sender: Hashable, now_nanos: int) -> Optional[Message]:
        """Take one datagram; return the message that it completed, if any.

        Parameters
        ----------
        datagram
            The bytes as they came; the buffer may be reused once this returns.
        sender
            The sender's address.
        now_nanos
            Any clock that never goes back, in nanoseconds.
        """
        try:
            header, offset = parse(datagram)
            return self.accept(header, memoryview(datagram)[offset:], sender, now_nanos)
        except Refused as refused:
            self.counters.refuse(refused.reason)
            return None

    def accept(
        self, header: Header, part: memoryview, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        """Do as `receive` does with a datagram that is parsed already.

        Raises
        ------
        Refused
            When the part contradicts its message; the caller counts it.
        """
        self.expire(now_nanos)
        if header.parts_max > 1 and not len(part):
            raise Refused("part_size")
        if header.msg_type == CONTROL:
            return self._accept_control(header, part)
        topic = self._holdings.topic(sender, (header.msg_type, header.topic))
        if topic.order.is_restart_by_silence(header, now_nanos):
            self._holdings.give_up_topic(topic)
            topic.order.forget()
        if topic.order.is_finished(header):
            topic.count("duplicates")
            return None
        topic.link = header.link
        if header.parts_max == 1 and key_of(header) not in topic.open:
            return self._finish(topic, header, part, now_nanos)
        return self._add(topic, header, part, now_nanos)

    def expire(self, now_nanos: int) -> None:
        """Give up the messages whose time is over."""
        self._holdings.give_up_since(now_nanos - self.limits.time_limit_nanos)

    def give_up_all(self) -> None:
        """Count every open message as incomplete, as at the end of a recording."""
        self._holdings.give_up_since()

    def tallies(self, sender: Hashable) -> Iterator[Tuple[int, str, str, Counters]]:
        """Yield msg_type, topic, the link last seen and the counters of each topic of a sender."""
        for (msg_type, name), topic in self._holdings.topics(sender):
            yield msg_type, name, topic.link, topic.counters

    # Control says what is so at this moment and repeats itself; credits carry old stamps and
    # reports a wall clock, so order has no meaning there, and a dropped one would only harm.
    def _accept_control(self, header: Header, part: memoryview) -> Message:
        if header.parts_max != 1:
            raise Refused("parts_max")
        control.parse(part)
        self.counters.messages += 1
        return _message(header, part)

    def _add(
        self, topic: Topic, header: Header, part: memoryview, now_nanos: int
    ) -> Optional[Message]:
        """Add a part to its message, which may be a new one."""
        key = key_of(header)
        assembly = topic.open.get(key) or Assembly(header, now_nanos)
        added = assembly.add(header, part)
        if added.refused:
            self.counters.refuse(added.refused)
        if added.is_duplicate:
            topic.count("duplicates")
            return None
        if not assembly.complete:
            self._holdings.hold(topic, key, assembly)
            return None
        self._holdings.release(topic, key)
        return self._finish(topic, header, assembly.body, now_nanos)

    def _finish(
        self, topic: Topic, header: Header, body: memoryview, now_nanos: int
    ) -> Optional[Message]:
        """Judge a whole message by the order of its topic; return it unless it is late."""
        order = topic.order
        is_ahead = order.ahead_by(header.seq_number) > 0
        if not is_ahead and order.is_newer(header):
            self._holdings.give_up_topic(topic, before_nanos=header.stamp_nanos)
            order.forget()
            is_ahead = True
        order.finish(header)
        if is_ahead:
            topic.count("missing", order.hand_over(header, now_nanos))
        elif not self.limits.keep_late:
            topic.count("late")
            return None
        topic.count("messages")
        return _message(header, body)


def _message(header: Header, body: memoryview) -> Message:
    # A single part still lies in the caller's buffer; what was joined lies in one of its own.
    kept = memoryview(bytes(body)) if header.parts_max == 1 else body
    return Message(
        header.msg_type,
        header.topic,
        header.link,
        header.stamp_nanos,
        header.seq_number,
        kept,
        header.parts_max,
    )
