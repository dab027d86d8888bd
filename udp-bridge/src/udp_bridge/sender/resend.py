# SPDX-License-Identifier: Apache-2.0
"""Retransmission towards one destination: history, queue, budget, and offers.

Sent messages are kept until they are stale. A receiver requests what it lost; the budget limits how
much is resent. Offers tell the receiver which message was sent last, so that it notices a lost end
and needs no timer of its own.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Iterator, NamedTuple, Optional, Tuple

from udp_bridge.wire.fragments import Split, datagram_of, flat
from udp_bridge.wire.header import NANOS, PARTS_MAX, SEQ_NUMBERS, Header
from udp_bridge.wire.message import Message, TopicKey
from udp_bridge.wire.repair import Offer, Request
from udp_bridge.wire.types import RESEND

HISTORY_BYTES = 64 << 20
"""Most body bytes in the history. Bodies are the caller's own and are not copied."""
HISTORY_MESSAGES = 4096
DEBOUNCE_NANOS = 1_500_000
"""An equal request within this time is a duplicate."""
QUEUED_MAX = 2 * PARTS_MAX
"""Most datagrams that wait to be resent."""

BUDGET_WINDOW_S = 4
"""Within this time one second's goodput may be resent: in the long run a quarter of the goodput."""
BURST_BYTES = 1 << 20
"""This much may be resent within that time whatever the goodput (16 of the largest datagrams), but
no more than was sent for the first time. On a slow link resends are therefore at most half of all
traffic."""
GRAIN_NANOS = NANOS // 10
"""Resolution of the times at which goodput was reported."""
MINIMUM_BYTES = 131_072
"""This much may always be resent, even of topics with little traffic."""

FIRST_STEP_NANOS = 1_000_000
"""The offer of a multi-part message is repeated after this time, then after twice as long..."""
SMALL_STEP_NANOS = 5_000_000
"""...and the offer of a single-part message after this time. A topic of single-part messages gets
no more than one offer within it."""
LONGEST_STEP_NANOS = 20_000_000
"""Longest time between two offers of a message."""

MessageKey = Tuple[int, str, int]
"""msg_type, topic and seq_number."""


class HistoryEntry:
    """A message that was sent, or is being sent."""

    __slots__ = (
        "cut",
        "limit_nanos",
        "message",
        "packed",
        "parts_sent",
        "request",
        "requested_nanos",
        "since_nanos",
    )

    def __init__(
        self, message: Message, cut: Split, packed: bytes, limit_nanos: int, now_nanos: int
    ) -> None:
        self.message = message
        self.cut = cut
        self.packed = packed
        """The header of part 0."""
        self.limit_nanos = limit_nanos
        self.parts_sent = 0
        self.request: Optional[Request] = None
        """The newest request for it."""
        self.requested_nanos = 0
        self.since_nanos = now_nanos
        """When its first part was sent."""

    @property
    def key(self) -> MessageKey:
        """Identifies the message."""
        return self.message.msg_type, self.message.topic, self.message.seq_number


class QueuedResend(NamedTuple):
    """A datagram that waits to be resent."""

    entry: HistoryEntry
    part_number: int

    @property
    def size(self) -> int:
        """Bytes of the datagram; a last part may be far smaller than the others."""
        part_size = self.entry.cut.part_size
        left = flat(self.entry.message.body).nbytes - self.part_number * part_size
        return len(self.entry.packed) + min(part_size, left)

    def datagram(self) -> Tuple[bytes, memoryview]:
        """Return its header and its slice of the body."""
        entry = self.entry
        return datagram_of(entry.packed, flat(entry.message.body), entry.cut, self.part_number)


class Resender:
    """Retransmission towards one destination."""

    def __init__(self) -> None:
        self.resent = 0
        """Datagrams that were resent."""
        self.over_budget = 0
        """Requested datagrams that were not resent because the budget was exhausted."""
        self.history_bytes = 0
        self._history: OrderedDict[MessageKey, HistoryEntry] = OrderedDict()  # oldest first
        self._queue: OrderedDict[Tuple[MessageKey, int], QueuedResend] = OrderedDict()
        self._budget = ResendBudget()
        self._offers = OfferSchedule()

    def add(
        self, message: Message, cut: Split, packed: bytes, limit_nanos: int, now_nanos: int
    ) -> HistoryEntry:
        """Keep a message whose first part is about to be sent; the caller calls `parts_sent`."""
        entry = HistoryEntry(message, cut, packed, limit_nanos, now_nanos)
        self._forget(entry.key)
        self._history[entry.key] = entry
        size = flat(message.body).nbytes
        self.history_bytes += size
        self._budget.sent(size, now_nanos)
        self._clean(now_nanos)
        return entry

    def parts_sent(self, entry: HistoryEntry, count: int, now_nanos: int) -> None:
        """Count parts that were sent; a complete message is offered from now on."""
        entry.parts_sent += count
        if entry.parts_sent == entry.cut.parts_max:
            self._offers.put(entry, now_nanos)

    def requested(self, header: Header, request: Request, now_nanos: int) -> None:
        """Queue the requested datagrams that are in the history and within the budget."""
        self._clean(now_nanos)
        self._budget.goodput_reported(request.goodput, now_nanos)
        for resend in self._find(header, request, now_nanos):
            key = (resend.entry.key, resend.part_number)
            if key in self._queue:
                continue
            is_full = len(self._queue) >= QUEUED_MAX
            if is_full or not self._budget.spend(resend.size, now_nanos):
                self.over_budget += 1
                continue
            self._queue[key] = resend
        if self._queue and request.parts:
            message = (request.msg_type, header.topic, header.seq_number)
            # Behind a single resent part an immediate offer could overtake it unnoticed.
            is_single = len(request.parts) == 1
            self._offers.hasten(message, now_nanos + FIRST_STEP_NANOS * is_single)

    @property
    def is_idle(self) -> bool:
        """Whether no datagram waits to be resent."""
        return not self._queue

    def next_resend(self, now_nanos: int) -> Optional[QueuedResend]:
        """Return the next datagram to resend; it stays queued until `resend_sent`."""
        while self._queue:
            resend = next(iter(self._queue.values()))
            if now_nanos - resend.entry.since_nanos <= resend.entry.limit_nanos:
                return resend
            self._queue.popitem(last=False)
        return None

    def resend_sent(self) -> None:
        """Remove the datagram that `next_resend` returned from the queue."""
        self._queue.popitem(last=False)
        self.resent += 1

    def next_offer(self, now_nanos: int) -> Optional[bytes]:
        """Return an offer that is due, as a complete datagram."""
        return self._offers.take(now_nanos)

    @property
    def next_offer_nanos(self) -> Optional[int]:
        """When the next offer is due; None if there is none."""
        return self._offers.next_nanos

    def _find(self, header: Header, request: Request, now_nanos: int) -> Iterator[QueuedResend]:
        """Yield the requested datagrams that were sent and are in the history."""
        for offset in range(request.messages):
            seq_number = (header.seq_number + offset) % SEQ_NUMBERS
            entry = self._history.get((request.msg_type, header.topic, seq_number))
            if entry is None:
                continue
            if request.parts and (
                request.parts_max != entry.cut.parts_max
                or header.stamp_nanos != entry.message.stamp_nanos
            ):
                continue
            if entry.request == request and now_nanos - entry.requested_nanos < DEBOUNCE_NANOS:
                continue
            entry.request, entry.requested_nanos = request, now_nanos
            for part in request.parts or range(entry.cut.parts_max):
                if part < entry.parts_sent:
                    yield QueuedResend(entry, part)

    def _clean(self, now_nanos: int) -> None:
        """Forget stale messages, and the oldest ones beyond the limits."""
        while self._history:
            key, entry = next(iter(self._history.items()))
            is_stale = now_nanos - entry.since_nanos > entry.limit_nanos
            is_full = self.history_bytes > HISTORY_BYTES or len(self._history) > HISTORY_MESSAGES
            if not is_stale and not is_full:
                return
            self._forget(key)

    def _forget(self, key: MessageKey) -> None:
        entry = self._history.pop(key, None)
        if entry is not None:
            self.history_bytes -= flat(entry.message.body).nbytes


class _RecentBytes:
    """Bytes within the last `BUDGET_WINDOW_S`."""

    def __init__(self) -> None:
        self.total = 0
        self._items: Deque[Tuple[int, int]] = deque()  # time, bytes

    def add(self, size: int, now_nanos: int) -> None:
        self.forget(now_nanos)
        self._items.append((now_nanos, size))
        self.total += size

    def forget(self, now_nanos: int) -> None:
        since_nanos = now_nanos - BUDGET_WINDOW_S * NANOS
        while self._items and self._items[0][0] <= since_nanos:
            self.total -= self._items.popleft()[1]


class ResendBudget:
    """Limits resends to a quarter of the reported goodput, with bursts.

    On a full link, resends would increase the loss that they repair. Losses come in bursts, and a
    few large datagrams are lost a message at a time, so the share is applied over some seconds. It
    uses the best second among them, because after a pause the newest one says little.
    """

    def __init__(self) -> None:
        self._sent = _RecentBytes()
        self._spent = _RecentBytes()
        self._goodput: Deque[Tuple[int, int]] = deque()  # time and goodput, falling: best first

    def sent(self, size: int, now_nanos: int) -> None:
        """Count a body of `size` bytes that is sent for the first time."""
        self._sent.add(size, now_nanos)

    def goodput_reported(self, goodput: int, now_nanos: int) -> None:
        """Take the bytes that the receiver got within a second, as it reports them.

        `spend` never assumes that more arrived than was sent.
        """
        while self._goodput and self._goodput[-1][1] <= goodput:
            self._goodput.pop()
        if not self._goodput or now_nanos - self._goodput[-1][0] >= GRAIN_NANOS:
            self._goodput.append((now_nanos, goodput))
        while self._goodput[0][0] <= now_nanos - BUDGET_WINDOW_S * NANOS:
            self._goodput.popleft()

    def spend(self, size: int, now_nanos: int) -> bool:
        """Take `size` bytes from the budget; return whether they were available."""
        self._sent.forget(now_nanos)
        self._spent.forget(now_nanos)
        sent, goodput = self._sent.total, self._goodput[0][1] if self._goodput else 0
        most = max(min(goodput, sent // BUDGET_WINDOW_S), min(BURST_BYTES, sent), MINIMUM_BYTES)
        if self._spent.total + size > most:
            return False
        self._spent.add(size, now_nanos)
        return True


class _TopicOffer:
    """The newest complete message of a topic, and when it is offered next."""

    __slots__ = ("due_nanos", "entry", "sent_nanos", "step_nanos")

    def __init__(self, entry: HistoryEntry, now_nanos: int) -> None:
        self.entry = entry
        self.due_nanos = now_nanos
        self.sent_nanos = now_nanos - SMALL_STEP_NANOS
        self.step_nanos = FIRST_STEP_NANOS

    def datagram(self) -> bytes:
        message, limit_ms = self.entry.message, -(-self.entry.limit_nanos // 1_000_000)
        body = Offer(message.msg_type, self.entry.cut.parts_max, limit_ms).pack()
        return message._replace(msg_type=RESEND, link="").header().pack() + body


class OfferSchedule:
    """Offers of the newest complete message of each topic: at once, then ever less often."""

    def __init__(self) -> None:
        self._topics: OrderedDict[TopicKey, _TopicOffer] = OrderedDict()

    def put(self, entry: HistoryEntry, now_nanos: int) -> None:
        """Offer this message from now on instead of the previous one of its topic."""
        key = entry.key[:2]
        offer = self._topics.pop(key, None)
        is_small = entry.cut.parts_max == 1
        if offer is None:
            offer = _TopicOffer(entry, now_nanos)
        elif is_small and now_nanos - offer.sent_nanos < SMALL_STEP_NANOS:
            offer.due_nanos = offer.sent_nanos + SMALL_STEP_NANOS
        else:
            offer.due_nanos = now_nanos
        offer.entry = entry
        offer.step_nanos = SMALL_STEP_NANOS if is_small else FIRST_STEP_NANOS
        self._topics[key] = offer

    def hasten(self, key: MessageKey, due_nanos: int) -> None:
        """Offer a multi-part message at this time, and then as often as in the beginning.

        Its resent parts may be lost again, and the receiver has no timer of its own. A message
        that is no longer the newest of its topic is not offered.
        """
        offer = self._topics.get(key[:2])
        if offer is not None and offer.entry.key == key and offer.entry.cut.parts_max > 1:
            offer.due_nanos, offer.step_nanos = due_nanos, FIRST_STEP_NANOS

    def take(self, now_nanos: int) -> Optional[bytes]:
        """Return an offer that is due, as a complete datagram."""
        for key, offer in self._topics.items():
            if offer.due_nanos > now_nanos:
                continue
            if now_nanos > offer.entry.since_nanos + offer.entry.limit_nanos:
                del self._topics[key]
                return self.take(now_nanos)
            offer.sent_nanos = now_nanos
            offer.due_nanos = now_nanos + offer.step_nanos
            offer.step_nanos = min(2 * offer.step_nanos, LONGEST_STEP_NANOS)
            return offer.datagram()
        return None

    @property
    def next_nanos(self) -> Optional[int]:
        """When the next offer is due; None if there is none."""
        if not self._topics:
            return None
        return min(offer.due_nanos for offer in self._topics.values())
