# SPDX-License-Identifier: Apache-2.0
"""What a link does with a datagram that came in: messages out, credits taken, answers written.

No socket, no thread, no clock: answers are returned as bytes to send. Credits go back for
multi-part messages without being asked for; reports only where they are wanted.
"""

from __future__ import annotations

from typing import Callable, List, Optional, Tuple, cast

from udp_bridge.wire.address_validation import AddressChallenge, AddressResponse
from udp_bridge.wire.control import Credit, CreditRequest, LinkReport, TopicReport
from udp_bridge.wire.header import FIXED_SIZE, Header, Refused, parse
from udp_bridge.wire.message import Address, DatagramKey, Message
from udp_bridge.wire.repair import Request, parse_resend
from udp_bridge.wire.types import CONTROL, REPAIR, RESEND

from .batch_reassembly import RunReassembler
from .delivery_reports import Answer, Telling, Told, control_of
from .limits import Limits
from .peers import Peer, Peers
from .receive_slots import NO_SLOTS, CreditState, PartBatch, ReceiveSlots, SlotPredictor
from .verdicts import message_of

CREDIT_SHARE = 8
"""A credit goes out at the latest when one part in this many of the receive buffer was taken."""
_CREDIT_BODY = 12
_REQUEST_BODY = 8
"""Before its bitmap."""

Taken = Tuple[Optional[Message], Optional[Answer], Address]
OnCredit = Callable[[Address, DatagramKey, int], None]
OnRequest = Callable[[Address, Header, Request], None]
OnReport = Callable[[Address, str, TopicReport, int], None]
OnOrder = Callable[[], None]
OnChallenge = Callable[[Address, AddressChallenge], None]


class Inbox:
    """Everything between a socket that receives and the messages that came in."""

    def __init__(
        self,
        *,
        receive_buffer: int,
        on_credit: OnCredit,
        on_report: OnReport = lambda *_: None,
        on_request: OnRequest = lambda *_: None,
        on_order: OnOrder = lambda: None,
        on_challenge: OnChallenge = lambda *_: None,
        limits: Optional[Limits] = None,
    ) -> None:
        self.receive_buffer = receive_buffer
        """Bytes of the socket's receive buffer, as the kernel accounts them."""
        self.reassembler = RunReassembler(limits)
        self.datagrams = 0
        self.bytes_received = 0
        self.kernel_drops = 0
        """Datagrams that the kernel dropped for want of buffer; the socket's owner sets it."""
        self.requests_sent = 0
        """Requests to send something again."""
        self.answers_sent = self.answer_bytes_sent = 0
        """Credits and requests that went out where parts are received, not by who called us."""
        self._on_credit = on_credit
        self._on_report = on_report
        self._on_request = on_request
        self._on_order = on_order
        self._on_challenge = on_challenge
        self._telling = Telling(self.reassembler)
        self.take_note = self._telling.take_note
        self.published = self._telling.published
        self.dropped = self._telling.dropped
        self._peers = Peers(self.reassembler.limits.senders)
        self._predictor = SlotPredictor(self.reassembler.pool)

    @property
    def told(self) -> List[Told]:
        """Sender, topic, link and report: what `reports` told last."""
        return self._telling.told

    def receive(
        self, datagram: memoryview, sender: Address, now_nanos: int, wall_nanos: int
    ) -> Tuple[Optional[Message], Optional[Answer]]:
        """Take one datagram; return the message that it completed and the credit to send.

        Parameters
        ----------
        datagram
            Its bytes; the buffer may be reused once this returns.
        sender
            Where it came from.
        now_nanos
            A clock that never goes back.
        wall_nanos
            The wall clock, for the ages of messages.
        """
        self.datagrams += 1
        size = len(datagram)
        self.bytes_received += size
        late = self.reassembler.counters.late
        try:
            header, offset = parse(datagram)
            if header.msg_type == CONTROL:
                return self._take_control(header, datagram[offset:], sender, now_nanos)
            message = self.reassembler.accept(header, datagram[offset:], sender, now_nanos)
        except Refused as refused:
            self.reassembler.counters.refuse(refused.reason)
            return None, None
        peer = self._peers.heard(sender, now_nanos)
        peer.goodput_bytes += size
        if header.msg_type == RESEND:
            peer.goodput(now_nanos)
            if message is not None:
                self._take_request(header, message, sender)
            return None, None
        if header.parts_max == 1:
            return message, None
        if message is None and header.msg_type != REPAIR:
            self._follow(header, datagram[:offset], sender, now_nanos)
        peer.uncredited_bytes += size
        is_whole = message is not None or self.reassembler.counters.late != late
        return message, self._credit_if_due(header, is_whole, sender, peer)

    def predict_slots(self) -> Tuple[ReceiveSlots, CreditState]:
        """Return where to put what comes next, and how to acknowledge it; for `receive_run`."""
        place = self._predictor.predict()
        if not place.arrived:
            return NO_SLOTS, CreditState(0, self.receive_buffer, 0)
        peer = self._peers.get(place.sender)
        if peer is None:
            return place, CreditState(0, self.receive_buffer, 0)
        number = peer.numbering.next(CONTROL, self._predictor.topic, 0)
        return place, CreditState(
            peer.uncredited_bytes, self.receive_buffer, number, peer.goodput_told
        )

    def receive_run(self, place: ReceiveSlots, run: PartBatch, now_nanos: int) -> List[Taken]:
        """Take what came at a place; return what `receive` returns, and the sender.

        Parts that lie in their places are taken together.
        """
        taken: List[Taken] = []
        if run.mailbox_credits:
            self._count_parked(run, now_nanos)
        if run.is_send_order_done:
            self._on_order()
        if run.part_ranges:
            taken.append(self._receive_placed(place, run, now_nanos))
        if run.refused:
            self.refuse(run.refused)
        elif run.unmatched is not None:
            assert run.unmatched_sender is not None
            one = self.receive(memoryview(run.unmatched), run.unmatched_sender, now_nanos, 0)
            taken.append((*one, run.unmatched_sender))
        return taken

    def _count_parked(self, run: PartBatch, now_nanos: int) -> None:
        """Count credits that went to the sender without us, as `_take_control` does with others."""
        self.reassembler.expire(now_nanos)
        self.datagrams += run.mailbox_credits
        self.bytes_received += run.mailbox_bytes
        self.reassembler.counters.messages += run.mailbox_credits

    def _receive_placed(self, place: ReceiveSlots, run: PartBatch, now_nanos: int) -> Taken:
        sender = place.sender
        header = self._predictor.header_of(run)
        count, (first, in_row) = run.parts_count, run.part_ranges[-1]
        size = count * (len(run.header) + place.part_size) - (place.part_size - run.last_part_size)
        self.datagrams += count
        self.bytes_received += size
        late = self.reassembler.counters.late
        message = self.reassembler.accept_run(header, place, run, sender, now_nanos)
        if message is None:
            known = self.reassembler.open_message(header, sender, now_nanos)
            self._predictor.on_incomplete(run, known, self.reassembler.asking(header, sender))
        else:
            self._predictor.on_complete(run)
        peer = self._peers.heard(sender, now_nanos)
        peer.goodput_bytes += size
        if place.debounce_nanos:
            peer.goodput_told = peer.goodput(now_nanos)
        if run.credits_sent:
            peer.numbering.next(CONTROL, header.topic, run.credits_sent)
            self.answers_sent += run.credits_sent
            self.answer_bytes_sent += run.credits_sent * (_head_size(header) + _CREDIT_BODY)
        if run.nack_bitmap:
            self.requests_sent += 1
            self.answers_sent += 1
            self.answer_bytes_sent += _head_size(header) + _REQUEST_BODY + len(run.nack_bitmap)
        peer.uncredited_bytes = run.uncredited_bytes
        if not run.uncredited_bytes:
            return message, None, sender
        last = header._replace(part_number=first + in_row - 1)
        is_whole = message is not None or self.reassembler.counters.late != late
        return message, self._credit_if_due(last, is_whole, sender, peer), sender

    def _follow(self, header: Header, head: memoryview, sender: Address, now_nanos: int) -> None:
        known = self.reassembler.open_message(header, sender, now_nanos)
        asking = self.reassembler.asking(header, sender)
        self._predictor.follow(header, bytes(head), sender, known, asking)

    def _credit_if_due(
        self, header: Header, is_whole: bool, sender: Address, peer: Peer
    ) -> Optional[Answer]:
        is_end = is_whole or header.part_number == header.parts_max - 1
        if not is_end and peer.uncredited_bytes <= self.receive_buffer // CREDIT_SHARE:
            return None
        return self._credit(header, sender, peer)

    def _credit(self, header: Header, sender: Address, peer: Peer) -> Answer:
        peer.uncredited_bytes = 0
        credit = Credit(header.msg_type, header.part_number, header.seq_number, self.receive_buffer)
        return control_of(peer, header.topic, "", header.stamp_nanos, credit), sender

    def requests(self, now_nanos: int) -> List[Answer]:
        """Return what is missed and to be asked for now, as datagrams to send."""
        answers: List[Answer] = []
        for sender, topic, (seq_number, (sec, nsec), request, copies) in self.reassembler.asked():
            to = cast(Address, sender)
            peer = self._peers.get(to)
            goodput = peer.goodput(now_nanos) if peer is not None else 0
            head = Header(RESEND, seq_number, 0, 1, sec, nsec, topic).pack()
            answers += [(head + request._replace(goodput=goodput).pack(), to)] * copies
            self.requests_sent += 1
        return answers

    def expect_nothing(self) -> None:
        """Forget what is expected next; `predict_slots` begins anew with what comes."""
        self._predictor = SlotPredictor(self.reassembler.pool)

    def refuse(self, reason: str) -> None:
        """Count a datagram that was refused before it came here."""
        self.datagrams += 1
        self.reassembler.counters.refuse(reason)

    def reports(self, now_nanos: int, wall_nanos: int) -> List[Answer]:
        """Return what to tell the senders that were heard lately about what arrived."""
        link_report = LinkReport.of(
            self.receive_buffer,
            self.datagrams,
            self.bytes_received,
            self.kernel_drops,
            self.reassembler.counters.refused,
        )
        return self._telling.reports(self._peers, link_report, now_nanos, wall_nanos)

    def close(self) -> None:
        """Let go of buffers, of what was known of senders and of whom to tell; the counters stay.

        Who is told refers to us again: without this, both would wait for the garbage collector.
        """
        self._on_credit = self._on_report = self._on_request = self._on_order = _nobody
        self._on_challenge = _nobody
        self.reassembler.close()
        self.expect_nothing()

    def _take_request(self, header: Header, message: Message, sender: Address) -> None:
        request = parse_resend(message.body)
        if isinstance(request, Request):
            self._on_request(sender, header, request)

    def _take_control(
        self, header: Header, body: memoryview, sender: Address, now_nanos: int
    ) -> Tuple[Optional[Message], Optional[Answer]]:
        self.reassembler.expire(now_nanos)
        told = self.reassembler.accept_control(header, body)
        if isinstance(told, CreditRequest):
            return None, self._credit(header, sender, self._peers.heard(sender, now_nanos))
        if isinstance(told, Credit):
            key = DatagramKey(told.msg_type, header.topic, told.seq_number, told.part_number)
            self._on_credit(sender, key, told.receive_buffer)
            return None, None
        if isinstance(told, AddressChallenge):
            self._on_challenge(sender, told)
        if isinstance(told, (AddressChallenge, AddressResponse)):
            return None, None
        if isinstance(told, TopicReport):
            self._on_report(sender, header.topic, told, header.stamp_nanos)
        return message_of(header, body), None


def _head_size(header: Header) -> int:
    """Return the size of an answer's header."""
    size = FIXED_SIZE + len(header.topic.encode())
    return size + -size % 4


def _nobody(*_: object) -> None:
    """Tell nobody."""
