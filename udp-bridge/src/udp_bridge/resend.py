# SPDX-License-Identifier: Apache-2.0
"""What a sender keeps to send again, how much of that it may send, and what it offers.

Towards one destination. History is bounded in time, by each topic's own limit, and in bytes;
what goes out again is bounded by a share of what the receiver says arrives. No socket, no
clock; which datagram goes first is `sending`'s.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Dict, Iterator, NamedTuple, Optional, Tuple

from .fragments import Split, datagram_of, flat
from .header import NANOS, PARTS_MAX, SEQ_NUMBERS, Header
from .message import Message
from .repair_wire import Offer, Request
from .types import RESEND

HISTORY_BYTES = 64 << 20
"""Bodies that are kept; they are the caller's own, so nothing is copied."""
HISTORY_MESSAGES = 4096
GOODPUT_SHARE = 0.25
"""Of what arrives, this much may be sent again: resends on a full link make it worse."""
GOODPUT_FLOOR_BYTES = 131_072
"""May be sent again within a second in any case, so that repair can begin: two of the largest."""
WINDOW_NANOS = NANOS
FIRST_STEP_NANOS = 1_000_000
"""The offer of a message of several parts is repeated after this, then after twice as long..."""
SMALL_STEP_NANOS = 5_000_000
"""...that of a single-part message, of which there are many, after this. These are not offered
more often than that either."""
LONGEST_STEP_NANOS = 20_000_000
"""Offers are repeated at least this often, until their message is stale."""
DEBOUNCE_NANOS = 1_500_000
"""A part that went out again is not sent once more so soon: requests come in copies."""
WAITING_MAX = 2 * PARTS_MAX
"""Datagrams that wait to be sent again."""

Key = Tuple[int, str, int]
"""msg_type, topic and seq_number."""


class Sent:
    """A message in the history."""

    __slots__ = (
        "again_nanos",
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
        self.again_nanos: Dict[int, int] = {}
        """When a part was last queued to be sent again."""
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

    def datagram(self) -> Tuple[bytes, memoryview]:
        """Return its header and the slice of the body."""
        return datagram_of(self.sent.packed, flat(self.sent.message.body), self.sent.cut, self[1])


class _Offered:
    """When a topic's newest message is offered next."""

    __slots__ = ("due_nanos", "sent", "step_nanos", "told_nanos")

    def __init__(self, sent: Sent, now_nanos: int) -> None:
        self.sent = sent
        self.due_nanos = now_nanos
        self.told_nanos = now_nanos - SMALL_STEP_NANOS
        self.step_nanos = FIRST_STEP_NANOS


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
        self._offers: OrderedDict[Tuple[int, str], _Offered] = OrderedDict()
        self._spent: Deque[Tuple[int, int]] = deque()  # when, and how many bytes
        self._spent_bytes = 0
        self._left: Deque[Tuple[int, int]] = deque()  # the same of bodies that left
        self._left_bytes = 0

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
        self._left.append((now_nanos, size))
        self._left_bytes += size
        self._clean(now_nanos)
        return sent

    def is_out(self, sent: Sent, now_nanos: int) -> None:
        """Take note that the last part of a message went out: it is offered from now on."""
        topic = sent.key[:2]
        offered = self._offers.pop(topic, None)
        is_small = sent.cut.parts_max == 1
        if offered is None:
            offered = _Offered(sent, now_nanos)
        elif is_small and now_nanos - offered.told_nanos < SMALL_STEP_NANOS:
            offered.due_nanos = offered.told_nanos + SMALL_STEP_NANOS
        else:
            offered.due_nanos = now_nanos
        offered.sent = sent
        offered.step_nanos = SMALL_STEP_NANOS if is_small else FIRST_STEP_NANOS
        self._offers[topic] = offered

    def asked(self, header: Header, request: Request, now_nanos: int) -> None:
        """Queue what a receiver asks for, as far as it is kept and the budget allows."""
        self._clean(now_nanos)
        # No more can have come than was sent, whatever the receiver says.
        goodput = min(request.goodput, self._left_bytes)
        budget = max(GOODPUT_FLOOR_BYTES, int(goodput * GOODPUT_SHARE))
        for again in self._kept(header, request):
            place = (again.sent.key, again.part_number)
            last_nanos = again.sent.again_nanos.get(again.part_number)
            if last_nanos is not None and now_nanos - last_nanos < DEBOUNCE_NANOS:
                continue
            if place in self._waiting:
                continue
            size = len(again.sent.packed) + again.sent.cut.part_size
            if self._spent_bytes + size > budget or len(self._waiting) >= WAITING_MAX:
                self.over_budget += 1
                continue
            again.sent.again_nanos[again.part_number] = now_nanos
            self._waiting[place] = again
            self._spent.append((now_nanos, size))
            self._spent_bytes += size

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
        for topic, offered in self._offers.items():
            if offered.due_nanos > now_nanos:
                continue
            sent = offered.sent
            if now_nanos - sent.since_nanos > sent.limit_nanos:
                del self._offers[topic]
                return self.next_offer(now_nanos)
            offered.told_nanos = now_nanos
            offered.due_nanos = now_nanos + offered.step_nanos
            offered.step_nanos = min(2 * offered.step_nanos, LONGEST_STEP_NANOS)
            message = sent.message
            limit_ms = -(-sent.limit_nanos // 1_000_000)
            body = Offer(message.msg_type, sent.cut.parts_max, limit_ms).pack()
            return message._replace(msg_type=RESEND, link="").header().pack() + body
        return None

    @property
    def next_offer_nanos(self) -> Optional[int]:
        """When an offer is due; None when there is none."""
        return min((offered.due_nanos for offered in self._offers.values()), default=None)

    def _kept(self, header: Header, request: Request) -> Iterator[Again]:
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
            for part in parts:
                if part < sent.parts_sent:
                    yield Again(sent, part)

    def _clean(self, now_nanos: int) -> None:
        """Forget what is stale, and the oldest of what is too much."""
        while self._spent and self._spent[0][0] <= now_nanos - WINDOW_NANOS:
            self._spent_bytes -= self._spent.popleft()[1]
        while self._left and self._left[0][0] <= now_nanos - WINDOW_NANOS:
            self._left_bytes -= self._left.popleft()[1]
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
