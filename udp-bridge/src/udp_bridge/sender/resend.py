# SPDX-License-Identifier: Apache-2.0
"""What a sender keeps to send again, and what of it is asked for: towards one destination.

History is bounded in time, by each topic's own limit, and in bytes. How much may go out again is
`resend_budget`'s, what is offered when `resend_offers`'s; which datagram goes first is
`sending`'s. No socket, no clock.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Iterator, NamedTuple, Optional, Tuple

from udp_bridge.wire.fragments import Split, datagram_of, flat
from udp_bridge.wire.header import PARTS_MAX, SEQ_NUMBERS, Header
from udp_bridge.wire.message import Message
from udp_bridge.wire.repair import Request

from .resend_budget import Budget
from .resend_offers import FIRST_STEP_NANOS, Offered, Offers

HISTORY_BYTES = 64 << 20
"""Bodies that are kept; they are the caller's own, so nothing is copied."""
HISTORY_MESSAGES = 4096
DEBOUNCE_NANOS = 1_500_000
"""A request that comes again so soon is a copy."""
WAITING_MAX = 2 * PARTS_MAX
"""Datagrams that wait to be sent again."""

Key = Tuple[int, str, int]
"""msg_type, topic and seq_number."""


class Sent:
    """A message in the history."""

    __slots__ = (
        "asked",
        "asked_nanos",
        "cut",
        "limit_nanos",
        "message",
        "packed",
        "parts_sent",
        "since_nanos",
    )

    def __init__(self, message: Message, cut: Split, packed: bytes, limit_nanos: int) -> None:
        self.message = message
        self.cut = cut
        self.packed = packed
        """The header of part 0."""
        self.limit_nanos = limit_nanos
        self.parts_sent = 0
        self.asked: Optional[Request] = None
        """What was asked for last, and when."""
        self.asked_nanos = 0
        self.since_nanos = 0
        """When its first part went out."""

    @property
    def key(self) -> Key:
        """What tells it from others."""
        return self.message.msg_type, self.message.topic, self.message.seq_number


class Again(NamedTuple):
    """A datagram that is to be sent again."""

    sent: Sent
    part_number: int

    @property
    def size(self) -> int:
        """Its bytes; a last part may be far smaller than the others."""
        part_size = self.sent.cut.part_size
        left = flat(self.sent.message.body).nbytes - self.part_number * part_size
        return len(self.sent.packed) + min(part_size, left)

    def datagram(self) -> Tuple[bytes, memoryview]:
        """Return its header and the slice of the body."""
        return datagram_of(self.sent.packed, flat(self.sent.message.body), self.sent.cut, self[1])


class Resender:
    """History, budget and offers of one destination."""

    def __init__(self) -> None:
        self.resent = 0
        """Datagrams that were sent again."""
        self.over_budget = 0
        """Datagrams that were asked for in vain, for want of goodput."""
        self.history_bytes = 0
        self._history: OrderedDict[Key, Sent] = OrderedDict()  # by order of leaving
        self._waiting: OrderedDict[Tuple[Key, int], Again] = OrderedDict()
        self._budget = Budget()
        self._offers = Offers()

    def leaves(
        self, message: Message, cut: Split, packed: bytes, limit_nanos: int, now_nanos: int
    ) -> Sent:
        """Keep a message that begins to leave; the caller counts `parts_sent` up."""
        sent = Sent(message, cut, packed, limit_nanos)
        sent.since_nanos = now_nanos
        self._let_go(sent.key)
        self._history[sent.key] = sent
        size = flat(message.body).nbytes
        self.history_bytes += size
        self._budget.left(size, now_nanos)
        self._clean(now_nanos)
        return sent

    def is_out(self, sent: Sent, now_nanos: int) -> None:
        """Take note that the last part of a message went out: it is offered from now on."""
        stale_nanos = sent.since_nanos + sent.limit_nanos
        offered = Offered(sent.message, sent.cut.parts_max, sent.limit_nanos, stale_nanos)
        self._offers.put(offered, now_nanos)

    def asked(self, header: Header, request: Request, now_nanos: int) -> None:
        """Queue what a receiver asks for, as far as it is kept and the budget allows."""
        self._clean(now_nanos)
        self._budget.told(request.goodput, now_nanos)
        for again in self._kept(header, request, now_nanos):
            place = (again.sent.key, again.part_number)
            if place in self._waiting:
                continue
            if len(self._waiting) >= WAITING_MAX or not self._budget.spend(again.size, now_nanos):
                self.over_budget += 1
                continue
            self._waiting[place] = again
        if self._waiting and request.parts:
            key = (request.msg_type, header.topic, header.seq_number)
            is_alone = len(request.parts) == 1  # nothing of it can tell that the offer is not early
            self._offers.hasten(key, now_nanos + FIRST_STEP_NANOS * is_alone)

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits to be sent again."""
        return not self._waiting

    def next_again(self, now_nanos: int) -> Optional[Again]:
        """Return the datagram that is to be sent again next; it waits until `sent_again`."""
        while self._waiting:
            again = next(iter(self._waiting.values()))
            if now_nanos - again.sent.since_nanos <= again.sent.limit_nanos:
                return again
            self._waiting.popitem(last=False)
        return None

    def sent_again(self) -> None:
        """Take note that what `next_again` returned went out."""
        self._waiting.popitem(last=False)
        self.resent += 1

    def next_offer(self, now_nanos: int) -> Optional[bytes]:
        """Return an offer that is due, as a whole datagram."""
        return self._offers.take(now_nanos)

    @property
    def next_offer_nanos(self) -> Optional[int]:
        """When an offer is due; None when there is none."""
        return self._offers.next_nanos

    def is_offer_due(self, now_nanos: int) -> bool:
        """Tell whether `next_offer` would return one."""
        due_nanos = self._offers.next_nanos
        return due_nanos is not None and due_nanos <= now_nanos

    def _kept(self, header: Header, request: Request, now_nanos: int) -> Iterator[Again]:
        """Yield what is asked for and has been sent, of messages that are in the history."""
        for offset in range(request.messages):
            seq_number = (header.seq_number + offset) % SEQ_NUMBERS
            sent = self._history.get((request.msg_type, header.topic, seq_number))
            if sent is None:
                continue
            parts = request.parts or tuple(range(sent.cut.parts_max))
            if request.parts and (
                request.parts_max != sent.cut.parts_max
                or header.stamp_nanos != sent.message.stamp_nanos
            ):
                continue
            if sent.asked == request and now_nanos - sent.asked_nanos < DEBOUNCE_NANOS:
                continue
            sent.asked, sent.asked_nanos = request, now_nanos
            for part in parts:
                if part < sent.parts_sent:
                    yield Again(sent, part)

    def _clean(self, now_nanos: int) -> None:
        """Forget what is stale, and the oldest of what is too much."""
        while self._history:
            key, sent = next(iter(self._history.items()))
            is_stale = now_nanos - sent.since_nanos > sent.limit_nanos
            is_too_much = (
                self.history_bytes > HISTORY_BYTES or len(self._history) > HISTORY_MESSAGES
            )
            if not is_stale and not is_too_much:
                return
            self._let_go(key)

    def _let_go(self, key: Key) -> None:
        sent = self._history.pop(key, None)
        if sent is not None:
            self.history_bytes -= flat(sent.message.body).nbytes
