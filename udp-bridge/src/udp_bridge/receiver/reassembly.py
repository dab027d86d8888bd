# SPDX-License-Identifier: Apache-2.0
"""Reassembly: datagrams in, complete messages out, by the receiving rules of PROTOCOL.md.

A bad datagram is counted by reason and changes nothing else. Time is an argument, a sender is any
hashable object, and no reference to a datagram's buffer is kept. `limits` bounds what is held,
`delivery` decides about complete messages, `inbox` handles credits and control messages.
"""

from __future__ import annotations

from itertools import chain
from typing import Hashable, List, Optional, Tuple

from udp_bridge.wire import control, fec
from udp_bridge.wire.header import SEQ_NUMBERS, Buffer, Header, Refused, parse
from udp_bridge.wire.message import Message, TopicKey
from udp_bridge.wire.repair import Offer, parse_resend, parse_symbol
from udp_bridge.wire.reports import TopicReport
from udp_bridge.wire.types import CONTROL, REPAIR, RESEND, SUBSCRIBE

from .assembly import Assembly
from .delivery import DeliveryRules, message_of
from .delivery_log import Counters, DeliveryLog
from .limits import Limits, SenderTable, TopicState
from .nack import Nack, NackTracker
from .ordering import MessageKey, key_of
from .pool import BlockPool
from .receive_slots import PartBatch, ReceiveSlots
from .small_topics import DeliveredMessage, TopicOrigin

_NOT_DELIVERED = (control.CreditRequest, control.AddressChallenge, control.AddressResponse)


class Reassembler:
    """Joins datagrams of any number of senders into messages.

    Call `receive` for every datagram, and `expire` from time to time while none arrives.
    """

    def __init__(self, limits: Optional[Limits] = None) -> None:
        self.limits = limits if limits is not None else Limits()
        self.counters = Counters()
        self.pool = BlockPool()
        self._senders = SenderTable(self.limits, self.counters)
        self._rules = DeliveryRules(self._senders, self.counters, keep_late=self.limits.keep_late)
        self.pending_nacks: List[Tuple[Hashable, str, Nack]] = []
        """What `take_nacks` returns next."""

    @property
    def memory_bytes(self) -> int:
        """Memory of all open messages."""
        return self._senders.memory_bytes

    def receive(self, datagram: Buffer, sender: Hashable, now_nanos: int) -> Optional[Message]:
        """Take one datagram; return the message that it completed, if any.

        Parameters
        ----------
        datagram
            The received bytes; the buffer may be reused after this call.
        sender
            The sender's address.
        now_nanos
            A monotonic clock.
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
        """Take one parsed datagram; return the message that it completed, if any.

        Raises
        ------
        Refused
            If the part contradicts its message; the caller counts it.
        """
        if self._senders.memory_bytes:  # otherwise nothing is open
            self.expire(now_nanos)
        if header.parts_max > 1 and not len(part):
            raise Refused("part_size")
        if header.msg_type == CONTROL:
            self.accept_control(header, part)
            return message_of(header, part)
        if header.msg_type == RESEND:
            return self._accept_resend(header, part, sender, now_nanos)
        if header.msg_type == REPAIR:
            return self._accept_symbol(header, part, sender, now_nanos)
        if header.msg_type == SUBSCRIBE:
            if header.parts_max != 1:
                raise Refused("parts_max")
            control.Subscribe.parse(part)
        if self._senders.memory_bytes:  # it may contradict an open message
            self._check(header, len(part), sender, now_nanos)
        topic = self._topic(sender, (header.msg_type, header.topic))
        is_plain = header.parts_max == 1 and topic.nacks is None and not topic.open
        if is_plain and topic.order.deliver_next(header, now_nanos):
            topic.link = header.link
            return self._rules.deliver(topic, header, part)
        self._rules.detect_restart(topic, header, now_nanos)
        if topic.order.is_finished(header):
            topic.count_duplicates()
            return None
        key = key_of(header)
        is_open = key in topic.open
        if not is_open and self._rules.drops_jump(topic, header, now_nanos):
            return None
        topic.link = header.link
        topic.log.mark_arrived(header)
        if header.parts_max == 1 and not is_open:
            message = self._rules.deliver_in_order(topic, header, part, now_nanos)
        else:
            message = self._add_part(topic, key, header, part, now_nanos)
        if topic.nacks is not None:
            is_complete = topic.order.is_finished(header)
            topic.nacks.on_parts(header, is_complete=is_complete, now_nanos=now_nanos)
            self._queue_nacks(topic.nacks, header, header.msg_type, sender, now_nanos)
        return message

    # A Control message is valid at once and is repeated. Credits carry old stamps and reports carry
    # a wall clock, so their order means nothing, and dropping one would only do harm.
    def accept_control(self, header: Header, part: memoryview) -> control.Control:
        """Return the body of a Control message, or raise `Refused`."""
        if header.parts_max != 1:
            raise Refused("parts_max" if len(part) else "part_size")
        body = control.parse(part)
        self.counters.messages += not isinstance(body, _NOT_DELIVERED)
        return body

    def accept_batch(
        self, header: Header, slots: ReceiveSlots, batch: PartBatch, now_nanos: int
    ) -> Optional[Message]:
        """Take parts that lie in their slots, with the same result as `accept` for each of them.

        `header` is that of the first part. Refused parts are counted; nothing is raised.
        """
        if self._senders.memory_bytes:  # otherwise nothing is open
            self.expire(now_nanos)
        sender = slots.sender
        topic = self._senders.find(sender, (header.msg_type, header.topic))
        assembly = None
        if topic is not None:
            topic.end_small()
            if batch.part_ranges == ((0, header.parts_max),) and not slots.is_open:
                message = self._accept_whole(topic, header, slots, batch, now_nanos)
                if message is not None:
                    return message
            if topic.nacks is not None:
                self._rules.detect_restart(topic, header, now_nanos)
                if batch.nack_bitmap and not topic.order.is_finished(header):
                    topic.nacks.on_requested(header, batch.nack_bitmap, batch.nack_nanos, now_nanos)
            if slots.is_open or self._senders.may_begin(sender, now_nanos):
                assembly = self._assembly_in(topic, header, slots, now_nanos)
        if topic is None or assembly is None:
            return self._accept_each(header, slots, batch, now_nanos)
        self._rules.log_delivered()
        self._senders.topic(sender, (header.msg_type, header.topic))  # now the one used last
        topic.link = header.link
        topic.log.mark_arrived(header)
        key = key_of(header)
        for first, count in batch.part_ranges:
            assembly.mark_received(first, count, batch.last_part_size)
        if key not in topic.open:
            self._senders.hold(topic, key, assembly)
            if key not in topic.open:  # it was too large and was given up
                topic.count_duplicates(batch.parts_count - 1)
                return None
        message = None
        if assembly.is_complete:
            self._senders.release(topic, key)
            message = self._rules.deliver_in_order(topic, header, assembly.body, now_nanos)
        if topic.nacks is not None:
            is_complete = message is not None or topic.order.is_finished(header)
            for first, count in batch.part_ranges:
                part = header._replace(part_number=first)
                topic.nacks.on_parts(
                    part, is_complete=is_complete, now_nanos=now_nanos, count=count
                )
            self._queue_nacks(topic.nacks, header, header.msg_type, sender, now_nanos)
        return message

    def _accept_whole(
        self,
        topic: TopicState,
        header: Header,
        slots: ReceiveSlots,
        batch: PartBatch,
        now_nanos: int,
    ) -> Optional[Message]:
        """Fast path: return a message that arrived in one batch, if it is next and nothing is open.

        Then it need not be held, nothing is to be requested, and it cannot be late.
        """
        announced_bytes = slots.part_size * header.parts_max
        nacks = topic.nacks
        if (
            not self._senders.fits_alone(announced_bytes)
            or (nacks is not None and not nacks.is_settled((header.seq_number - 1) % SEQ_NUMBERS))
            or not topic.order.deliver_next(header, now_nanos)
        ):
            return None
        self._senders.topic(slots.sender, (header.msg_type, header.topic))  # now the one used last
        topic.link = header.link
        view = memoryview(slots.block)
        self.pool.take_offered(slots.block, announced_bytes)
        if nacks is not None:
            nacks.on_parts(header, is_complete=True, now_nanos=now_nanos)
        size = announced_bytes - slots.part_size + batch.last_part_size
        return self._rules.deliver(topic, header, view[:size].toreadonly())

    def _assembly_in(
        self, topic: TopicState, header: Header, slots: ReceiveSlots, now_nanos: int
    ) -> Optional[Assembly]:
        """Return the message that lies in the slots; None if it needs the rules of `accept`."""
        if topic.order.is_restart_after_silence(header, now_nanos) or topic.is_jump(header):
            return None
        assembly = topic.open.get(key_of(header))
        if assembly is not None:
            is_there = assembly.block is slots.block and not assembly.has_symbols
            return assembly if is_there else None
        if slots.is_open or topic.order.is_finished(header):
            return None
        assembly = Assembly(header, now_nanos, self.pool)
        return assembly if assembly.adopt_block(slots.block, slots.part_size) else None

    def _accept_each(
        self, header: Header, slots: ReceiveSlots, batch: PartBatch, now_nanos: int
    ) -> Optional[Message]:
        message = None
        for number in chain.from_iterable(
            range(first, first + n) for first, n in batch.part_ranges
        ):
            start = number * slots.part_size
            is_last = number == header.parts_max - 1
            end = start + (batch.last_part_size if is_last else slots.part_size)
            part = memoryview(slots.block)[start:end]
            try:
                source = header._replace(part_number=number)
                one = self.accept(source, part, slots.sender, now_nanos)
                message = message or one
            except Refused as refused:
                self.counters.refuse(refused.reason)
        return message

    def steady_topic(self, header: Header, sender: Hashable) -> Optional[TopicState]:
        """Return the topic of a delivered message if the next one in order will be delivered too.

        Number and stamp tell that while its messages have one part and nothing is to be repaired.
        """
        topic = self._senders.find(sender, (header.msg_type, header.topic))
        if topic is None or topic.nacks is not None or topic.open:
            return None
        return topic if topic.order.is_at_end(header) else None

    def last_whole(self, source: TopicOrigin, size: int) -> Optional[MessageKey]:
        """Return the last message of a topic if the next one is delivered when it arrives whole.

        `size` is what it announces. It holds until the next datagram is taken.
        """
        topic = self._senders.find(source.sender, source.key)
        if (
            topic is None
            or topic.small is not None
            or not topic.sender.is_proven
            or not self._senders.fits_alone(size)
        ):
            return None
        last = topic.order.last
        if last is None or (topic.nacks is not None and not topic.nacks.is_settled(last[0])):
            return None
        return last

    def record(self, message: DeliveredMessage) -> None:
        """Apply the rules to a message that its user has got already."""
        source = message.source
        topic = self._senders.topic(source.sender, source.key)
        topic.order.record_next(message.key, message.now_nanos)
        if topic.nacks is not None:
            topic.nacks.on_whole(message.key)
        topic.link = source.link
        topic.log.mark_delivered(message.key, message.body_size)

    def _topic(self, sender: Hashable, key: TopicKey) -> TopicState:
        """Return the topic of a datagram that takes the ordinary path, as the one used last."""
        self._rules.log_delivered()
        topic = self._senders.topic(sender, key)
        topic.end_small()
        return topic

    def take_nacks(self) -> List[Tuple[Hashable, str, Nack]]:
        """Return the requests that became due since the last call, with sender and topic."""
        nacks, self.pending_nacks = self.pending_nacks, []
        return nacks

    def expire(self, now_nanos: int) -> None:
        """Give up the messages whose time limit has passed."""
        self._senders.give_up_since(now_nanos - self.limits.time_limit_nanos)

    def give_up_all(self) -> None:
        """Give up every open message, as at the end of a recording."""
        self._senders.give_up_since()

    def close(self) -> None:
        """Forget all senders and free the blocks; open messages count as incomplete."""
        self._senders.forget_all()
        self.pool = BlockPool(0)

    def log_delivered(self) -> None:
        """Enter the last delivered message into its log, before the next message or report does."""
        self._rules.log_delivered()

    def reports(self, sender: Hashable, wall_nanos: int) -> List[Tuple[str, str, TopicReport]]:
        """Return topic, last link and report for each topic of a sender."""
        self.log_delivered()
        return [
            (name, topic.link, topic.report(msg_type, wall_nanos))
            for (msg_type, name), topic in self._senders.topics(sender)
        ]

    def delivery_log(self, sender: Hashable, msg_type: int, topic: str) -> Optional[DeliveryLog]:
        """Return the delivery log of a topic, or None if it is unknown."""
        found = self._senders.find(sender, (msg_type, topic))
        return found.log if found is not None else None

    def nack_tracker(self, header: Header, sender: Hashable) -> Optional[NackTracker]:
        """Return the tracker of a message's topic; None where nothing can be requested."""
        topic = self._senders.find(sender, (header.msg_type, header.topic))
        return topic.nacks if topic is not None else None

    def open_message(self, header: Header, sender: Hashable, now_nanos: int) -> Optional[Assembly]:
        """Return the open message of a header, or None."""
        topic = self._senders.find(sender, (header.msg_type, header.topic))
        if topic is None or topic.order.is_restart_after_silence(header, now_nanos):
            return None
        return topic.open.get(key_of(header))

    def _check(self, header: Header, size: int, sender: Hashable, now_nanos: int) -> None:
        """Refuse a part that contradicts its message, or that begins one too many."""
        assembly = self.open_message(header, sender, now_nanos)
        if assembly is not None:
            assembly.check(header, size)
        elif header.parts_max > 1 and not self._senders.may_begin(sender, now_nanos):
            raise Refused("busy")

    def _accept_resend(
        self, header: Header, part: memoryview, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        """Take an Offer; return a Request as a message, because the sending side handles it."""
        if header.parts_max != 1:
            raise Refused("parts_max")
        body = parse_resend(part)
        if not isinstance(body, Offer):
            return message_of(header, part)
        topic = self._topic(sender, (body.msg_type, header.topic))
        nacks = self._senders.track_nacks(topic)
        if nacks is not None:
            self._rules.detect_offered_restart(topic, nacks, header, now_nanos)
            is_finished = topic.order.is_finished(header)
            offered = header._replace(parts_max=body.parts_max)
            if not is_finished and self._rules.drops_jump(topic, offered, now_nanos, is_offer=True):
                return None
            nacks.on_offer(header, body, is_finished=is_finished, now_nanos=now_nanos)
            self._queue_nacks(nacks, header, body.msg_type, sender, now_nanos)
        return None

    def _accept_symbol(
        self, header: Header, part: memoryview, sender: Hashable, now_nanos: int
    ) -> Optional[Message]:
        """Add a repair symbol to its message; return the message if that completed it."""
        symbol, data = parse_symbol(part)
        if symbol.code != fec.RAPTORQ or not fec.is_available():
            raise Refused("repair_code")
        source = header._replace(
            msg_type=symbol.msg_type, part_number=0, parts_max=symbol.parts_max
        )
        known = self.open_message(source, sender, now_nanos)
        if known is not None:
            if source.link != known.header.link:
                raise Refused("link")
            known.check_symbol(symbol, data)
        elif not self._senders.may_begin(sender, now_nanos):
            raise Refused("busy")
        topic = self._topic(sender, (source.msg_type, source.topic))
        self._rules.detect_restart(topic, source, now_nanos)
        if topic.order.is_finished(source) or self._rules.drops_jump(topic, source, now_nanos):
            return None
        key = key_of(source)
        assembly = topic.open.get(key) or Assembly(source, now_nanos, self.pool)
        if not assembly.add_symbol(header.part_number, symbol, data):
            topic.count_duplicates()
            return None
        topic.link = source.link
        topic.log.mark_arrived(source)
        return self._hold_or_recover(topic, key, assembly, source, now_nanos)

    def _add_part(
        self, topic: TopicState, key: MessageKey, header: Header, part: memoryview, now_nanos: int
    ) -> Optional[Message]:
        """Add a part to its message, which may be a new one."""
        assembly = topic.open.get(key) or Assembly(header, now_nanos, self.pool)
        added = assembly.add(header, part)
        if added.refused:
            self.counters.refuse(added.refused)
        if added.is_duplicate:
            topic.count_duplicates()
            return None
        if not assembly.is_complete:
            return self._hold_or_recover(topic, key, assembly, header, now_nanos)
        self._senders.release(topic, key)
        return self._rules.deliver_in_order(topic, header, assembly.body, now_nanos)

    def _hold_or_recover(
        self,
        topic: TopicState,
        key: MessageKey,
        assembly: Assembly,
        header: Header,
        now_nanos: int,
    ) -> Optional[Message]:
        """Hold an incomplete message, or deliver it if its repair symbols complete it."""
        if not assembly.recover():
            self._senders.hold(topic, key, assembly)
            return None
        self._senders.release(topic, key)
        topic.log.outcomes.mark_repaired(header.seq_number)
        message = self._rules.deliver_in_order(topic, header, assembly.body, now_nanos)
        if message is not None:
            self.counters.repaired += 1
        return message

    def _queue_nacks(
        self, nacks: NackTracker, header: Header, msg_type: int, sender: Hashable, now_nanos: int
    ) -> None:
        for nack in nacks.take_due(msg_type, now_nanos):
            self.pending_nacks.append((sender, header.topic, nack))
