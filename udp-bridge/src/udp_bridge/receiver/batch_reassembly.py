# SPDX-License-Identifier: Apache-2.0
"""Runs of parts that were received into their places, taken together by the rules of `reassembly`.

What comes out is what would come out part by part, and where anything is special about a message,
that is what is done. Whether a datagram belongs to a run is judged in `placing`.
"""

from __future__ import annotations

from itertools import chain
from typing import Hashable, Optional

from udp_bridge.wire.header import Header, Refused
from udp_bridge.wire.message import Message

from .assembly import Assembly
from .limits import Topic
from .nack import Asking
from .ordering import key_of
from .reassembly import Reassembler
from .receive_slots import PartBatch, ReceiveSlots


class RunReassembler(Reassembler):
    """A reassembler that takes runs, too."""

    def accept_run(
        self, header: Header, place: ReceiveSlots, run: PartBatch, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        """Take parts that lie in their places, as `accept` would one after the other.

        Nothing is raised: what is refused is counted. `header` is that of the first part.
        """
        if self._holdings.memory_bytes:  # otherwise nothing is open
            self.expire(now_nanos)
        topic = self._holdings.find(sender, (header.msg_type, header.topic))
        assembly = None
        if topic is not None:
            if run.part_ranges == ((0, header.parts_max),) and not place.is_open:
                whole = self._accept_whole(topic, header, place, run, sender, now_nanos)
                if whole is not None:
                    return whole
            if topic.asking is not None:
                self._verdicts.notice_restart(topic, header, now_nanos)
                if run.nack_bitmap and not topic.order.is_finished(header):
                    topic.asking.has_asked(header, run.nack_bitmap, run.nack_nanos, now_nanos)
            if place.is_open or self._holdings.may_begin(sender, now_nanos):
                assembly = self._placed_at(topic, header, place, now_nanos)
        if topic is None or assembly is None:
            return self._accept_each(header, place, run, sender, now_nanos)
        self._holdings.topic(sender, (header.msg_type, header.topic))  # it was heard
        topic.link = header.link
        topic.arrived.seen(header)
        key = key_of(header)
        for first, count in run.part_ranges:
            assembly.placed(first, count, run.last_part_size)
        if key not in topic.open:
            self._holdings.hold(topic, key, assembly)
            if key not in topic.open:  # it took too much
                topic.count("duplicates", run.parts_count - 1)
                return None
        message = None
        if assembly.complete:
            self._holdings.release(topic, key)
            message = self._verdicts.finish(topic, header, assembly.body, now_nanos)
        if topic.asking is not None:
            is_whole = message is not None or topic.order.is_finished(header)
            for first, count in run.part_ranges:
                part = header._replace(part_number=first)
                topic.asking.saw(part, is_whole=is_whole, now_nanos=now_nanos, count=count)
            self._ask(topic.asking, header, header.msg_type, sender, now_nanos)
        return message

    def _accept_whole(
        self,
        topic: Topic,
        header: Header,
        place: ReceiveSlots,
        run: PartBatch,
        sender: Hashable,
        now_nanos: int,
    ) -> Optional[Message]:
        """Return a message that came in one run if it is the next one and nothing is open.

        As most are: then there is nothing to hold or to ask for, and nothing can be late.
        """
        announced_bytes = place.part_size * header.parts_max
        asking = topic.asking
        if (
            not self._holdings.takes_alone(announced_bytes)
            or (asking is not None and not asking.is_next(header))
            or not topic.order.takes_next(header, now_nanos)
        ):
            return None
        self._holdings.topic(sender, (header.msg_type, header.topic))  # it was heard
        topic.link = header.link
        view = memoryview(place.block)
        self.pool.take_offered(place.block, announced_bytes)
        if asking is not None:
            asking.saw(header, is_whole=True, now_nanos=now_nanos)
        size = announced_bytes - place.part_size + run.last_part_size
        return self._verdicts.handed(topic, header, view[:size].toreadonly())

    def _placed_at(
        self, topic: Topic, header: Header, place: ReceiveSlots, now_nanos: int
    ) -> Optional[Assembly]:
        """Return the message that lies at a place, if nothing is special about it."""
        if topic.order.is_restart_by_silence(header, now_nanos) or topic.is_jump(header):
            return None
        assembly = topic.open.get(key_of(header))
        if assembly is not None:
            is_there = assembly.block is place.block and assembly.symbols is None
            return assembly if is_there else None
        if place.is_open or topic.order.is_finished(header):
            return None
        assembly = Assembly(header, now_nanos, self.pool)
        return assembly if assembly.adopt(place.block, place.part_size) else None

    def _accept_each(
        self, header: Header, place: ReceiveSlots, run: PartBatch, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        message = None
        for number in chain.from_iterable(range(first, first + n) for first, n in run.part_ranges):
            start = number * place.part_size
            is_last = number == header.parts_max - 1
            end = start + (run.last_part_size if is_last else place.part_size)
            part = memoryview(place.block)[start:end]
            try:
                one = self.accept(header._replace(part_number=number), part, sender, now_nanos)
            except Refused as refused:
                self.counters.refuse(refused.reason)
                continue
            message = message or one
        return message

    def open_message(self, header: Header, sender: Hashable, now_nanos: int) -> Optional[Assembly]:
        """Return what is in of a message that is open."""
        return self._open(header, sender, now_nanos)

    def asking(self, header: Header, sender: Hashable) -> Optional[Asking]:
        """Return what is asked for of a message's topic; None where it can't be."""
        topic = self._holdings.find(sender, (header.msg_type, header.topic))
        return topic.asking if topic is not None else None
