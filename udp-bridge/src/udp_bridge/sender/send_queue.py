# SPDX-License-Identifier: Apache-2.0
"""Send queue of one destination: the messages that wait, and which datagram is sent next.

Order: single-part messages, requested resends, offers, parts of large messages. A message gets its
sequence number when it is sent, so a superseded message leaves no gap. No socket, thread or clock.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Deque, Dict, List, NamedTuple, Optional, Sequence, Tuple

from udp_bridge.wire.control import CreditRequest
from udp_bridge.wire.fragments import (
    DatagramSize,
    Parts,
    Split,
    TooLarge,
    check_datagram_size,
    datagram_of,
    flat,
    plan,
)
from udp_bridge.wire.header import Buffer, Header, is_stamp, restamped
from udp_bridge.wire.message import Address, DatagramKey, Message, TopicKey
from udp_bridge.wire.numbering import Numbering
from udp_bridge.wire.types import CONTROL, REPAIR

from .delivery_counts import DeliveryCounter
from .direct_senders import DirectSenders, SendLarge, SendSmall
from .flow_control import BATCH_BYTES, FlowControl, InFlight, kernel_bytes
from .repair import Fec, RepairTable, Resend, repair_parts
from .resend import HistoryEntry, QueuedResend, Resender
from .waiting import LargeMessages, LinkKey, QueueLimits, SmallMessages

MAX_TEMPLATES = 1024
"""Most topics, with their links, whose header is kept as a template."""

_NOTHING_SENT = (0, 0, 0)


class OutgoingBatch(NamedTuple):
    """Consecutive parts of one message that may be sent at once."""

    parts: Parts
    first: int
    """Number of the first part."""
    parts_count: int
    size: int
    """Bytes of all datagrams."""
    trailer: Optional[bytes] = None
    """A datagram to send right behind them."""

    @property
    def datagram_size(self) -> int:
        """Bytes of each datagram but the message's last one, which may be smaller."""
        return len(self.parts.packed) + self.parts.cut.part_size


class OutgoingDatagram(NamedTuple):
    """What to send next: `sendmsg([header, part], [], 0, to)`, or a batch."""

    header: bytes
    part: memoryview
    to: Address
    is_last: bool
    """Whether its message is completely sent with it."""
    batch: Optional[OutgoingBatch] = None
    """If given, send this instead."""


class DelegatedSend(NamedTuple):
    """The rest of a message, which the receiving thread sends as Credits arrive."""

    parts: Parts
    to: Address
    next_part: int
    end: int
    cost: int
    """Bytes of the peer's receive buffer that each part takes."""
    in_flight_bytes: int
    window_bytes: int
    in_flight: List[InFlight]
    """Oldest first; the newest entry is of the message itself."""


class _Template(NamedTuple):
    """A message that was sent; the next one of its topic often differs only in number and stamp."""

    packed: bytes
    """Header of part 0."""
    body_size: int
    cut: Split
    resend_limit_nanos: Optional[int]


class SendQueue:
    """All that waits for one destination."""

    def __init__(
        self,
        to: Address,
        datagram_size: DatagramSize,
        *,
        signed_peer: bool = False,
        repair: Optional[RepairTable] = None,
        reserve: int = 0,
        limits: Optional[QueueLimits] = None,
    ) -> None:
        self.to = to
        self.flow = FlowControl()
        self.delivery = DeliveryCounter(signed_peer=signed_peer)
        self.resender = Resender()
        self.superseded = 0
        """Messages that were dropped here because newer ones of their topic came."""
        self.too_large = 0
        """Messages that did not fit at any datagram size."""
        self.current_topic: TopicKey = (0, "")
        """The topic of the newest large message that was begun."""
        self._datagram_size = check_datagram_size(datagram_size)
        self._signed_peer = signed_peer
        self._reserve = reserve  # bytes of each datagram that a socket wrapper adds
        self._repair = repair if repair is not None else {}
        self._numbering = Numbering(signed_peer=signed_peer)  # of CreditRequests
        self._small = SmallMessages()
        self._large = LargeMessages(limits if limits is not None else {})
        self._templates: Dict[LinkKey, _Template] = {}
        self._planned: Optional[Tuple[Message, Split]] = None  # newest result of `_plan`
        # The large message that is being sent, with its number:
        self._message: Optional[Message] = None
        self._parts: Optional[Parts] = None  # what is left of it: its parts, then its repair data
        self._entry: Optional[HistoryEntry] = None
        self._fec: Optional[Fec] = None  # until its repair data is computed
        self._repair_datagrams: Deque[Tuple[bytes, memoryview]] = deque()  # of small messages

    def put(self, message: Message) -> None:
        """Queue a message; its seq_number is assigned when it is sent.

        Raises
        ------
        BadMessage
            When it can't be sent to this destination (`TooLarge`: at no datagram size).
        """
        try:
            is_small = self._plan(message).parts_max == 1
        except TooLarge:
            self.too_large += 1
            raise
        superseded = self._small.put(message) if is_small else self._large.put(message)
        for old in superseded:
            self.delivery.superseded(old)
        self.superseded += len(superseded)

    def send_directly(
        self, senders: DirectSenders, queues: Sequence[SendQueue], now_nanos: int, *fields: Any
    ) -> Tuple[int, int, int]:
        """Do `put` and `take` in one step for a message that has nothing to wait for.

        Parameters
        ----------
        queues
            The queues of all destinations. A message of several parts waits for them.
        fields
            Type, topic, link, stamp and body.

        Returns
        -------
        Bytes and number of the datagrams that were sent, and number of the message's parts; zeros
        if `put` must be used, which also validates.
        """
        if senders.small is not None and (size := self.send_small_directly(senders.small, *fields)):
            return size, 1, 1
        if senders.large is None or not all(queue.is_idle for queue in queues):
            return _NOTHING_SENT
        return self.send_large_directly(senders.large, now_nanos, *fields)

    def send_small_directly(
        self,
        send: SendSmall,
        msg_type: int,
        topic: str,
        link: str,
        stamp_nanos: int,
        body: Buffer,
    ) -> int:
        """Do `put` and `take` in one step for a small message that has nothing to wait for.

        Only number and stamp of its topic's template change. Returns the bytes of the datagram that
        `send` has sent, or 0 if `put` must be used, which also validates: the message may be the
        first of its topic, be large, have a repair mode, or be invalid.
        """
        template = self._templates.get((msg_type, topic, link))
        if template is None or self._small.messages or self._repair_datagrams:
            return 0
        packed, _, cut, _ = template
        if cut.parts_max != 1:
            return 0
        number = self.delivery.upcoming((msg_type, topic))
        try:
            size = send(self.to, packed, cut.part_size, number, stamp_nanos, body)
        except (TypeError, ValueError, OverflowError, BufferError):
            return 0
        if size < 0:
            return 0
        self.delivery.next_number((msg_type, topic), stamp_nanos, size)
        return len(packed) + size

    def send_large_directly(
        self,
        send: SendLarge,
        now_nanos: int,
        msg_type: int,
        topic: str,
        link: str,
        stamp_nanos: int,
        body: Buffer,
    ) -> Tuple[int, int, int]:
        """Do `put` and `take` in one step for a message that fits into the window as a whole.

        Call it only when the queue is idle. Number and stamp of its topic's template change, and
        the body must have the template's size. Returns as `send_directly`. Zeros: the message may
        be the first of its topic, be small, have a repair mode, be too large, or be invalid.
        """
        template = self._templates.get((msg_type, topic, link))
        if template is None or template.resend_limit_nanos is not None or not is_stamp(stamp_nanos):
            return _NOTHING_SENT
        packed, body_size, cut, _ = template
        count, size = cut.parts_max, len(packed) + cut.part_size
        offer_nanos = self.resender.next_offer_nanos
        if (
            count == 1
            or count * size > BATCH_BYTES
            or not self.flow.is_window_in_use
            or self.flow.window.room(size) < count
            or (offer_nanos is not None and offer_nanos <= now_nanos)
        ):
            return _NOTHING_SENT
        key = msg_type, topic
        number = self.delivery.upcoming(key)
        try:
            sent = send(self.to, packed, body_size, cut.part_size, count, number, stamp_nanos, body)
        except (TypeError, ValueError, OverflowError, BufferError):
            return _NOTHING_SENT
        if sent < 0:
            return _NOTHING_SENT
        self.current_topic = key
        self.delivery.next_number(key, stamp_nanos, body_size)
        total = body_size + count * len(packed)
        last_size = total - (count - 1) * size
        self.flow.sent(DatagramKey(msg_type, topic, number, 0), count, size, last_size, now_nanos)
        return total if sent == count else sent * size, sent, count

    def take_large_directly(
        self,
        now_nanos: int,
        most_bytes: int,
        msg_type: int,
        topic: str,
        link: str,
        stamp_nanos: int,
        body: Buffer,
    ) -> Optional[OutgoingDatagram]:
        """Do `put` and `take` in one step for a message of the same size as its topic's last one.

        Call it only when the queue is idle. None means that `put` must be used. The rest of the
        message is returned by `take`.
        """
        template = self._templates.get((msg_type, topic, link))
        if template is None or not most_bytes or not is_stamp(stamp_nanos):
            return None
        packed, body_size, cut, limit_nanos = template
        view, offer_nanos = flat(body), self.resender.next_offer_nanos
        is_offer_due = offer_nanos is not None and offer_nanos <= now_nanos
        if cut.parts_max == 1 or view.nbytes != body_size or is_offer_due:
            return None
        size = len(packed) + cut.part_size
        count = self.flow.allowed(size, min(most_bytes // size, cut.parts_max), now_nanos)
        if count < 1:
            return None
        number = self.delivery.next_number((msg_type, topic), stamp_nanos, view.nbytes)
        parts = Parts(restamped(packed, number, stamp_nanos), view, cut)
        message = Message(msg_type, topic, link, stamp_nanos, number, body)
        self._begin(message, parts, limit_nanos, now_nanos)
        return self._send_parts(parts, count, now_nanos, is_batch=True)

    def take(self, now_nanos: int, most_bytes: int = 0) -> Optional[OutgoingDatagram]:
        """Return what to send now, if anything may be sent.

        With `most_bytes`, parts of a large message are returned as a batch of up to this size.
        """
        if self._repair_datagrams:
            return OutgoingDatagram(*self._repair_datagrams.popleft(), self.to, is_last=False)
        if self._small.messages:
            return self._take_small(now_nanos)
        resend = self.resender.next_resend(now_nanos)
        if resend is not None:
            return self._take_resend(resend, now_nanos)
        # An offer follows the requested parts, so that the receiver can tell if they were lost.
        offer = self.resender.next_offer(now_nanos)
        if offer is not None:
            return OutgoingDatagram(offer, memoryview(b""), self.to, is_last=False)
        parts = self._next_parts(now_nanos)
        if parts is None:
            return None
        size = parts.datagram_size(parts.upcoming)
        if self.flow.is_request_due(size, now_nanos):
            return self._request_credit(now_nanos)
        most = max(1, min(most_bytes // size, parts.parts_left))
        count = self.flow.allowed(size, most, now_nanos)
        if not count:
            return None
        return self._send_parts(parts, count, now_nanos, is_batch=most_bytes >= size)

    def forget_templates(self, msg_type: int, topic: str) -> None:
        """Validate the next messages of a topic by `put`, because its repair mode has changed."""
        for key in [key for key in self._templates if key[:2] == (msg_type, topic)]:
            del self._templates[key]

    def delegate(self) -> Optional[DelegatedSend]:
        """Return the rest of the current message if it only waits for room in the window."""
        parts, message, window = self._parts, self._message, self.flow.window
        if (
            parts is None
            or message is None
            or parts.packed[0] == REPAIR
            or not self.flow.is_window_in_use
            or window.fits(parts.datagram_size(parts.upcoming))
            or not self.resender.is_idle
        ):
            return None
        in_flight = window.in_flight(message.msg_type, message.topic)
        if in_flight is None:
            return None
        upcoming, end = parts.upcoming, parts.cut.parts_max
        cost = kernel_bytes(len(parts.packed) + parts.cut.part_size)
        if in_flight[-1][0] != message.seq_number:
            in_flight.append((message.seq_number, upcoming, 0, cost, cost))
        bounds = window.in_flight_bytes, window.window_bytes
        return DelegatedSend(parts, self.to, upcoming, end, cost, *bounds, in_flight)

    def delegated_sent(self, count: int, now_nanos: int) -> OutgoingDatagram:
        """Count parts of the last `DelegatedSend` that were sent; return them."""
        assert self._parts is not None
        return self._send_parts(self._parts, count, now_nanos, is_batch=True)

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits. Offers do not count, because they are repeated for some time."""
        waiting = (
            self._small.messages or self._large.of_link or self._parts or self._repair_datagrams
        )
        return not waiting and self.resender.is_idle

    def next_wake(self, now_nanos: int) -> Optional[int]:
        """Return when to call `take` again if nothing happens; None when nothing waits."""
        if self._small.messages or self._repair_datagrams:
            return now_nanos
        resend = self.resender.next_resend(now_nanos)
        if resend is not None:
            return self.flow.next_wake(resend.size, now_nanos)
        offer_nanos, parts = self.resender.next_offer_nanos, self._next_parts(now_nanos)
        if parts is None:
            return offer_nanos
        wake_nanos = self.flow.next_wake(parts.datagram_size(parts.upcoming), now_nanos)
        return wake_nanos if offer_nanos is None else min(wake_nanos, offer_nanos)

    def _take_small(self, now_nanos: int) -> OutgoingDatagram:
        message, parts, limit_nanos, mode = self._number(self._small.pop())
        header, part = next(parts)
        if mode is not None:
            self._repair_datagrams.extend(repair_parts(message, parts.cut, mode))
        if limit_nanos is not None:
            entry = self.resender.add(message, parts.cut, header, limit_nanos, now_nanos)
            self.resender.parts_sent(entry, 1, now_nanos)
        return OutgoingDatagram(header, part, self.to, is_last=True)

    def _take_resend(self, resend: QueuedResend, now_nanos: int) -> Optional[OutgoingDatagram]:
        size = resend.size
        if self.flow.is_request_due(size, now_nanos):
            return self._request_credit(now_nanos)
        if not self.flow.may_send(size, now_nanos):
            return None
        key = DatagramKey(*resend.entry.key, resend.part_number)
        self.flow.sent(key, 1, size, size, now_nanos)
        self.resender.resend_sent()
        return OutgoingDatagram(*resend.datagram(), self.to, is_last=False)

    def _request_credit(self, now_nanos: int) -> OutgoingDatagram:
        number = self._numbering.next(CONTROL, "")
        header = Header(CONTROL, number, 0, 1, 0, 0).pack(signed_peer=self._signed_peer)
        body = memoryview(CreditRequest().pack())
        key = DatagramKey(CONTROL, "", number, 0)
        self.flow.requested(key, len(header) + body.nbytes, now_nanos)
        return OutgoingDatagram(header, body, self.to, is_last=False)

    def _next_parts(self, now_nanos: int) -> Optional[Parts]:
        """Return what is left of the current large message; begin the next one if needed."""
        if self._parts is None and self._large.of_link:
            message, parts, limit_nanos, self._fec = self._number(self._large.pop())
            self._begin(message, parts, limit_nanos, now_nanos)
        return self._parts

    def _begin(
        self, message: Message, parts: Parts, limit_nanos: Optional[int], now_nanos: int
    ) -> None:
        """Make a large message the current one."""
        self._message, self._parts, self._entry = message, parts, None
        self.current_topic = message.msg_type, message.topic
        if limit_nanos is not None:
            self._entry = self.resender.add(
                message, parts.cut, parts.packed, limit_nanos, now_nanos
            )

    def _send_parts(
        self, parts: Parts, count: int, now_nanos: int, *, is_batch: bool
    ) -> OutgoingDatagram:
        """Return the next `count` parts of the current message, which are sent now."""
        message, entry, first = self._message, self._entry, parts.upcoming
        assert message is not None
        parts.upcoming = end = first + count
        last_size = parts.datagram_size(end - 1)
        size = len(parts.packed) + parts.cut.part_size
        key = DatagramKey(parts.packed[0], message.topic, message.seq_number, first)
        self.flow.sent(key, count, size, last_size, now_nanos)
        if entry is not None:
            self.resender.parts_sent(entry, count, now_nanos)
        if not parts.parts_left:
            self._parts = None
            if self._fec is not None:
                self._parts, self._fec = repair_parts(message, parts.cut, self._fec), None
        is_last = self._parts is None
        if not is_batch:
            header, part = datagram_of(parts.packed, parts.body, parts.cut, first)
            return OutgoingDatagram(header, part, self.to, is_last)
        trailer = None
        if is_last and entry is not None:
            trailer = self.resender.next_offer(now_nanos)
        batch = OutgoingBatch(parts, first, count, (count - 1) * size + last_size, trailer)
        return OutgoingDatagram(parts.packed, parts.body, self.to, is_last, batch)

    def _plan(self, message: Message) -> Split:
        if self._planned is not None and self._planned[0] is message:
            return self._planned[1]
        is_fec = isinstance(self._repair.get((message.msg_type, message.topic)), Fec)
        cut = plan(
            message,
            self._datagram_size,
            signed_peer=self._signed_peer,
            coded=is_fec,
            reserve=self._reserve,
        )
        self._planned = message, cut
        return cut

    def _number(self, message: Message) -> Tuple[Message, Parts, Optional[int], Optional[Fec]]:
        """Give a message its number; return it, its parts, its resend limit, and its FEC mode."""
        cut = self._plan(message)
        self._planned = None  # do not keep the body
        body = flat(message.body)
        key = (message.msg_type, message.topic)
        number = self.delivery.next_number(key, message.stamp_nanos, body.nbytes)
        message = message._replace(seq_number=number)
        header = message.header(parts_max=cut.parts_max)
        parts = Parts(header.pack(signed_peer=self._signed_peer), body, cut)
        mode = self._repair.get(key)
        if isinstance(mode, Fec):
            return message, parts, None, mode
        limit_nanos = mode.limit_nanos if isinstance(mode, Resend) else None
        if limit_nanos is None or cut.parts_max > 1:  # no template for small resent messages
            if len(self._templates) >= MAX_TEMPLATES:
                self._templates.clear()
            template = _Template(parts.packed, body.nbytes, cut, limit_nanos)
            self._templates[message.msg_type, message.topic, message.link] = template
        return message, parts, limit_nanos, None


def take_in_turn(
    queues: List[SendQueue], now_nanos: int, most_bytes: int = 0
) -> Optional[OutgoingDatagram]:
    """Take from the first queue that may send, and move that queue to the end."""
    for index, queue in enumerate(queues):
        datagram = queue.take(now_nanos, most_bytes)
        if datagram is not None:
            queues.append(queues.pop(index))
            return datagram
    return None
