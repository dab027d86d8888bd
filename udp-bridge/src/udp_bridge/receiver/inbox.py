# SPDX-License-Identifier: Apache-2.0
"""Inbox: takes the datagrams of a socket; returns messages to deliver and datagrams to answer.

No socket, no thread, no clock. Credits for messages of several parts are returned at once; requests
and reports are returned when the caller asks for them.
"""

from __future__ import annotations

from typing import Callable, Iterator, List, Optional, Tuple, cast

from udp_bridge.wire.address_validation import AddressChallenge, AddressResponse
from udp_bridge.wire.control import Credit, CreditRequest, LinkReport, TopicReport
from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, Header, Refused, header_size, parse
from udp_bridge.wire.message import Address, DatagramKey, Message
from udp_bridge.wire.repair import Request, parse_resend
from udp_bridge.wire.types import CONTROL, REPAIR, RESEND, ROS_TYPES

from .delivery import message_of
from .delivery_reports import Answer, DeliveryReports, SentReport
from .limits import Limits
from .peers import Peer, PeerTable
from .reassembly import Reassembler
from .receive_slots import (
    CreditState,
    PartBatch,
    ReceiveSlots,
    SlotPredictor,
)
from .small_topics import SmallTopics, WholeMessage, state_of

CREDIT_SHARE = 8
"""A Credit is due at the latest when one part in this many of the receive buffer has arrived."""
UNLOGGED = 64
"""Most messages, or outcomes of messages, that wait to be entered into the delivery logs..."""
LOG_NANOS = NANOS // 10
"""...and the longest time that they wait."""
_CREDIT_BODY = 12
_REQUEST_BODY = 8
"""Without its bitmap."""

Received = Tuple[Optional[Message], Optional[Answer]]
"""A complete message and a Credit to send."""
OnCredit = Callable[[Address, DatagramKey, int], None]
OnRequest = Callable[[Address, Header, Request], None]
OnReport = Callable[[Address, str, TopicReport, int], None]
OnDelegationDone = Callable[[], None]
OnChallenge = Callable[[Address, AddressChallenge], None]


class Inbox:
    """Receiving half of a link, without its socket."""

    def __init__(
        self,
        *,
        receive_buffer: int,
        on_credit: OnCredit,
        on_report: OnReport = lambda *_: None,
        on_request: OnRequest = lambda *_: None,
        on_delegation_done: OnDelegationDone = lambda: None,
        on_challenge: OnChallenge = lambda *_: None,
        limits: Optional[Limits] = None,
    ) -> None:
        self.receive_buffer = receive_buffer
        """Size of the socket's receive buffer, as the kernel accounts it."""
        self.reassembler = Reassembler(limits)
        self.datagrams = 0
        self.bytes_received = 0
        self.kernel_drops = 0
        """Datagrams that the kernel dropped because the buffer was full; set by the caller."""
        self.requests_sent = 0
        """Requests to resend something."""
        self.socket_answers = self.socket_answer_bytes = 0
        """Credits and requests that the socket sent itself while it received a batch."""
        self._on_credit = on_credit
        self._on_report = on_report
        self._on_request = on_request
        self._on_delegation_done = on_delegation_done
        self._on_challenge = on_challenge
        self._reports = DeliveryReports(self.reassembler)
        self._logged_nanos = 0
        self.mark_published = self._reports.mark_published
        self.mark_dropped = self._reports.mark_dropped
        self._peers = PeerTable(self.reassembler.limits.senders)
        self._predictor = SlotPredictor(self.reassembler.pool)
        self.small_topics = SmallTopics()
        # Slots, but for the block, and Credits of a topic whose messages arrive whole; until the
        # delivered messages are recorded.
        self._steady: Optional[Tuple[ReceiveSlots, CreditState]] = None
        self._whole_credits = 0

    @property
    def last_reports(self) -> List[SentReport]:
        """The topic reports that `reports` returned last."""
        return self._reports.last

    def receive(self, datagram: memoryview, sender: Address, now_nanos: int) -> Received:
        """Take one datagram; return the message that it completed, and the Credit to send.

        Parameters
        ----------
        datagram
            The received bytes; the buffer may be reused after this call.
        sender
            The sender's address.
        now_nanos
            A monotonic clock.
        """
        message = self.small_topics.take(datagram, sender, now_nanos)
        if message is not None:
            self.count_delivered()
            return message, None
        self._record_delivered()
        self.datagrams += 1
        size = len(datagram)
        self.bytes_received += size
        late = self.reassembler.counters.late
        try:
            header, offset = parse(datagram)
            if header.msg_type == CONTROL:
                return self._receive_control(header, datagram[offset:], sender, now_nanos)
            message = self.reassembler.accept(header, datagram[offset:], sender, now_nanos)
        except Refused as refused:
            self.reassembler.counters.refuse(refused.reason)
            return None, None
        peer = self._peers.record(sender, now_nanos)
        peer.goodput_bytes += size
        if header.msg_type == RESEND:
            peer.goodput(now_nanos)
            if message is not None:
                self._receive_request(header, message, sender)
            return None, None
        if header.parts_max == 1:
            if message is not None and header.msg_type in ROS_TYPES:
                state = self.reassembler.steady_topic(header, sender)
                if state is not None:
                    packed = bytes(datagram[:offset])
                    state.small = self.small_topics.follow(header, packed, sender)
            return message, None
        if message is None and header.msg_type != REPAIR:
            assembly = self.reassembler.open_message(header, sender, now_nanos)
            nacks = self.reassembler.nack_tracker(header, sender)
            self._predictor.follow(header, bytes(datagram[:offset]), sender, assembly, nacks)
        peer.uncredited_bytes += size
        is_complete = message is not None or self.reassembler.counters.late != late
        return message, self._credit_if_due(header, is_complete, sender, peer)

    def predict_slots(self) -> Tuple[ReceiveSlots, CreditState]:
        """Return where to receive the next parts, and how to acknowledge them: for a batch."""
        if self._steady is not None:
            slots, credits = self._steady
            block = self.reassembler.pool.offer(slots.part_size * len(slots.arrived))
            return tuple.__new__(ReceiveSlots, (block, *slots[1:])), credits
        predictor, row = self._predictor, None
        source = predictor.next_source
        if source is not None:
            last = self.reassembler.last_whole(source, predictor.next_bytes)
            if last is not None:
                row = source, state_of(source.key[0], last), *source.key, source.link
        slots = predictor.predict(row)
        peer = self._peers.get(slots.sender) if slots.arrived else None
        if peer is None:
            return slots, CreditState(0, self.receive_buffer, 0)
        number = peer.numbering.next(CONTROL, predictor.topic_key[1], 0)
        return slots, CreditState(
            peer.uncredited_bytes, self.receive_buffer, number, peer.last_goodput
        )

    def receive_batch(
        self, slots: ReceiveSlots, batch: PartBatch, now_nanos: int
    ) -> Iterator[Tuple[Optional[Message], Optional[Answer], Address]]:
        """Take a batch that was received into slots; yield messages and Credits with their sender.

        A message is yielded before the rest of what follows its delivery.
        """
        if batch.part_ranges or batch.mailbox_credits:
            self._record_delivered()
        if batch.mailbox_credits:
            self._count_mailbox_credits(batch, now_nanos)
        if batch.is_delegation_done:
            self._on_delegation_done()
        if batch.part_ranges:
            yield from self._receive_parts(slots, batch, now_nanos)
        if batch.refused:
            self.refuse(batch.refused)
        elif batch.unmatched is not None:
            assert batch.unmatched_sender is not None
            one = self.receive(memoryview(batch.unmatched), batch.unmatched_sender, now_nanos)
            yield (*one, batch.unmatched_sender)

    def count_delivered(self) -> int:
        """Count the newest message that is delivered before it is recorded; return its time."""
        newest = self.small_topics.delivered[-1]
        self.datagrams += newest.parts
        self.bytes_received += newest.size
        self.reassembler.counters.messages += 1
        return newest.now_nanos

    def take_whole(self, whole: WholeMessage) -> None:
        """Count a message that is delivered before it is recorded."""
        self.small_topics.delivered.append(whole.delivered)
        self.count_delivered()

    def follow_whole(self, slots: ReceiveSlots, credits: CreditState, whole: WholeMessage) -> None:
        """Predict that the next message is like this one; `_record_delivered` does the rest."""
        self.reassembler.pool.take_offered(slots.block, slots.part_size * len(slots.arrived))
        self._whole_credits += whole.credits_sent
        number = (credits.seq_number + whole.credits_sent) % SEQ_NUMBERS
        self._steady = slots, CreditState(0, credits.receive_buffer, number, credits.goodput)

    def _count_credits(self, topic: str, peer: Peer, count: int) -> None:
        """Count Credits that the socket sent itself."""
        peer.numbering.next(CONTROL, topic, count)
        self.socket_answers += count
        self.socket_answer_bytes += count * (_header_size(topic) + _CREDIT_BODY)

    def _count_mailbox_credits(self, batch: PartBatch, now_nanos: int) -> None:
        """Count Credits that the socket put into the sender's mailbox like all others."""
        self.reassembler.expire(now_nanos)
        self.datagrams += batch.mailbox_credits
        self.bytes_received += batch.mailbox_bytes
        self.reassembler.counters.messages += batch.mailbox_credits

    def _receive_parts(
        self, slots: ReceiveSlots, batch: PartBatch, now_nanos: int
    ) -> Iterator[Tuple[Optional[Message], Optional[Answer], Address]]:
        sender = slots.sender
        header = self._predictor.header_of(batch)
        late = self.reassembler.counters.late
        message = self.reassembler.accept_batch(header, slots, batch, now_nanos)
        is_complete = message is not None or self.reassembler.counters.late != late
        if message is not None:
            yield message, None, sender
        count, (first, last_count) = batch.parts_count, batch.part_ranges[-1]
        size = count * (len(batch.header) + slots.part_size)
        size -= slots.part_size - batch.last_part_size
        self.datagrams += count
        self.bytes_received += size
        if message is None:
            assembly = self.reassembler.open_message(header, sender, now_nanos)
            nacks = self.reassembler.nack_tracker(header, sender)
            self._predictor.on_incomplete(batch, assembly, nacks)
        else:
            self._predictor.on_complete(batch.header)
        peer = self._peers.record(sender, now_nanos)
        peer.goodput_bytes += size
        if slots.debounce_nanos:
            peer.last_goodput = peer.goodput(now_nanos)
        if batch.credits_sent:
            self._count_credits(header.topic, peer, batch.credits_sent)
        if batch.nack_bitmap:
            self.requests_sent += 1
            self.socket_answers += 1
            self.socket_answer_bytes += _header_size(header.topic) + _REQUEST_BODY
            self.socket_answer_bytes += len(batch.nack_bitmap)
        peer.uncredited_bytes = batch.uncredited_bytes
        credit = None
        if batch.uncredited_bytes:
            last = header._replace(part_number=first + last_count - 1)
            credit = self._credit_if_due(last, is_complete, sender, peer)
        if message is None or credit is not None:
            yield None, credit, sender

    def _credit_if_due(
        self, header: Header, is_complete: bool, sender: Address, peer: Peer
    ) -> Optional[Answer]:
        is_end = is_complete or header.part_number == header.parts_max - 1
        if not is_end and peer.uncredited_bytes <= self.receive_buffer // CREDIT_SHARE:
            return None
        return self._credit(header, sender, peer)

    def _credit(self, header: Header, sender: Address, peer: Peer) -> Answer:
        peer.uncredited_bytes = 0
        credit = Credit(header.msg_type, header.part_number, header.seq_number, self.receive_buffer)
        return peer.pack_control(header.topic, "", header.stamp_nanos, credit), sender

    def requests(self, now_nanos: int) -> List[Answer]:
        """Return the requests for lost parts that are due now, as datagrams to send."""
        answers: List[Answer] = []
        for address, topic, (
            seq_number,
            (sec, nsec),
            request,
            copies,
        ) in self.reassembler.take_nacks():
            sender = cast(Address, address)
            peer = self._peers.get(sender)
            goodput = peer.goodput(now_nanos) if peer is not None else 0
            header = Header(RESEND, seq_number, 0, 1, sec, nsec, topic).pack()
            answers += [(header + request._replace(goodput=goodput).pack(), sender)] * copies
            self.requests_sent += 1
        return answers

    def update_logs(self) -> None:
        """Enter messages and their outcomes into the delivery logs."""
        self._record_delivered()
        self._reports.update_logs()

    def update_logs_if_due(self, now_nanos: int) -> None:
        """Update the logs now and then, because the next message should not wait for it."""
        if (
            len(self.small_topics.delivered) >= UNLOGGED
            or self._reports.waiting >= UNLOGGED
            or now_nanos - self._logged_nanos >= LOG_NANOS
        ):
            self._logged_nanos = now_nanos
            self.update_logs()

    def _record_delivered(self) -> None:
        """Do for messages that were delivered at once what follows a delivery."""
        delivered = self.small_topics.delivered
        if not delivered:
            return
        self.reassembler.log_delivered()
        for one in delivered:
            peer = self._peers.record(one.source.sender, one.now_nanos)
            peer.goodput_bytes += one.size
            self.reassembler.record(one)
        self.reassembler.expire(delivered[-1].now_nanos)
        delivered.clear()
        self._end_steady()

    def _end_steady(self) -> None:
        """Predict by what was recorded."""
        if self._steady is not None:
            slots, _ = self._steady
            peer = self._peers.get(slots.sender)
            if peer is not None:
                peer.uncredited_bytes = 0
                self._count_credits(self._predictor.topic_key[1], peer, self._whole_credits)
        self._steady, self._whole_credits = None, 0

    def reset_prediction(self) -> None:
        """Predict nothing until the next part arrives."""
        self._predictor = SlotPredictor(self.reassembler.pool)
        self._steady, self._whole_credits = None, 0

    def refuse(self, reason: str) -> None:
        """Count a datagram that was refused before it came here."""
        self.datagrams += 1
        self.reassembler.counters.refuse(reason)

    def reports(self, now_nanos: int, wall_nanos: int) -> List[Answer]:
        """Return reports to all senders that sent something lately, as datagrams to send."""
        self._record_delivered()
        link_report = LinkReport.of(
            self.receive_buffer,
            self.datagrams,
            self.bytes_received,
            self.kernel_drops,
            self.reassembler.counters.refused,
        )
        return self._reports.reports(self._peers, link_report, now_nanos, wall_nanos)

    def close(self) -> None:
        """Free buffers, senders and callbacks; the counters stay.

        The callbacks refer to the owner of this inbox. Without this, both would wait for the
        garbage collector.
        """
        self._on_credit = self._on_report = self._on_request = _ignore
        self._on_delegation_done = self._on_challenge = _ignore
        self._record_delivered()
        self.small_topics.close()
        self.reassembler.close()
        self.reset_prediction()

    def _receive_request(self, header: Header, message: Message, sender: Address) -> None:
        request = parse_resend(message.body)
        if isinstance(request, Request):
            self._on_request(sender, header, request)

    def _receive_control(
        self, header: Header, body: memoryview, sender: Address, now_nanos: int
    ) -> Received:
        self.reassembler.expire(now_nanos)
        control = self.reassembler.accept_control(header, body)
        if isinstance(control, CreditRequest):
            return None, self._credit(header, sender, self._peers.record(sender, now_nanos))
        if isinstance(control, Credit):
            key = DatagramKey(
                control.msg_type, header.topic, control.seq_number, control.part_number
            )
            self._on_credit(sender, key, control.receive_buffer)
            return None, None
        if isinstance(control, AddressChallenge):
            self._on_challenge(sender, control)
        if isinstance(control, (AddressChallenge, AddressResponse)):
            return None, None
        if isinstance(control, TopicReport):
            self._on_report(sender, header.topic, control, header.stamp_nanos)
        return message_of(header, body), None


def _header_size(topic: str) -> int:
    """Return the size of an answer's header."""
    return header_size(len(topic.encode()))


def _ignore(*_: object) -> None:
    """Do nothing."""
