# SPDX-License-Identifier: Apache-2.0
"""How much a sender may put on the wire now: credit where the peer gives it, else a rate.

Sans-IO: times are nanoseconds of one monotonic clock, and nothing waits here. Only datagrams of
multi-part messages are asked about; single-part ones are few and small, and go at once.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, List, Optional, Tuple

from udp_bridge.wire.header import NANOS
from udp_bridge.wire.message import DatagramKey

from .token_bucket import TokenBucket

DATAGRAM_OVERHEAD = 1024
ROUNDED_UP_TO = 16384
WINDOW_SHARE = 2
"""The window is half of the receive buffer: the kernel gives room back late, and only three
quarters of a buffer that is being read can be counted on."""
ASK_NANOS = 10_000_000
"""How long a full window may stand still before a Credit is asked for, and then asked for again."""
ANSWER_NANOS = 50_000_000
"""A peer that has never given a Credit has this long to answer."""
GIVE_UP_NANOS = NANOS
"""After this long of asking in vain, a peer that did no longer gives any."""
UNKNOWN_BUFFER = 212992
"""What is assumed of a peer's receive buffer before it says: Linux's default."""
TRACKED_DATAGRAMS = 4096
"""Datagrams remembered as in flight; half of 8 MiB hold fewer, even of 256 bytes."""


def kernel_bytes(size: int) -> int:
    """Return what a datagram takes of the receive buffer, rather too much than too little.

    Measured on loopback, Linux 6.18: up to 16 KiB the kernel rounds up to a power of two (2305
    bytes for 1472, 16,644 for 8192 and 9000), beyond it adds little (17,225 for 16,384, 66,576
    for 65,507).
    """
    rounding = size if size <= ROUNDED_UP_TO else 0
    return size + rounding + DATAGRAM_OVERHEAD


Flight = Tuple[int, int, int, int, int]
"""Parts in flight: seq_number, the first one, how many; what each of them takes of the receive
buffer, and what the last one does."""


class _Flight:
    """Datagrams of one message that were sent one after the other, all but the last as large."""

    __slots__ = ("cost", "count", "first", "last_cost", "message")

    def __init__(self, key: DatagramKey, count: int, cost: int, last_cost: int) -> None:
        self.message = key[:3]
        self.first = key.part_number
        self.count = count
        self.cost = cost
        self.last_cost = last_cost

    @property
    def total(self) -> int:
        return (self.count - 1) * self.cost + self.last_cost

    @property
    def row(self) -> Flight:
        return self.message[2], self.first, self.count, self.cost, self.last_cost

    def without(self, count: int) -> Tuple[int, bool]:
        """Take the first `count` away; return what they cost, and whether some are left."""
        if count >= self.count:
            return self.total, False
        self.first += count
        self.count -= count
        return count * self.cost, True


class CreditWindow:
    """Bounds what may lie in the peer's receive buffer: all sent after the newest credit."""

    def __init__(self) -> None:
        self.in_flight_bytes = 0
        """As the kernel of the receiver accounts them."""
        self._in_flight: Deque[_Flight] = deque()
        self._count = 0
        self.window_bytes = UNKNOWN_BUFFER // WINDOW_SHARE
        """What may be in flight, as the kernel of the receiver accounts it."""
        self.moved_nanos = 0
        """When something was last sent or acknowledged."""

    def sent(self, key: DatagramKey, size: int, now_nanos: int) -> None:
        """Take note that a datagram of `size` bytes went out."""
        self.sent_run(key, 1, size, size, now_nanos)

    def sent_run(
        self, key: DatagramKey, count: int, size: int, last_size: int, now_nanos: int
    ) -> None:
        """Take note of `count` parts, from `key` on, that went out one after the other."""
        cost, last_cost = kernel_bytes(size), kernel_bytes(last_size)
        flight = self._in_flight[-1] if self._in_flight else None
        if (
            flight is not None
            and flight.message == key[:3]
            and flight.first + flight.count == key.part_number
            and flight.cost == flight.last_cost == cost
        ):
            flight.count += count
            flight.last_cost = last_cost
        else:
            self._in_flight.append(_Flight(key, count, cost, last_cost))
        self.in_flight_bytes += (count - 1) * cost + last_cost
        self._count += count
        self.moved_nanos = now_nanos
        while self._count > TRACKED_DATAGRAMS:
            self._pop(1)

    def acknowledged(self, key: DatagramKey, receive_buffer: int, now_nanos: int) -> None:
        """Take a credit; one for a datagram that is not in flight only tells the buffer's size."""
        self.window_bytes = receive_buffer // WINDOW_SHARE
        self.moved_nanos = now_nanos
        before, message = 0, key[:3]
        for flight in self._in_flight:
            ahead = key.part_number - flight.first
            if flight.message == message and 0 <= ahead < flight.count:
                self._pop(before + ahead + 1)
                return
            before += flight.count

    def is_in_flight(self, key: DatagramKey) -> bool:
        """Return whether a datagram was sent and not acknowledged yet."""
        message = key[:3]
        return any(
            flight.message == message and 0 <= key.part_number - flight.first < flight.count
            for flight in self._in_flight
        )

    def fits(self, size: int) -> bool:
        """Tell whether a datagram of `size` bytes may go; one may always when none is in flight."""
        total = self.in_flight_bytes + kernel_bytes(size)
        return not self._in_flight or total <= self.window_bytes

    def room(self, size: int) -> int:
        """Return how many datagrams of `size` bytes fit now, as `fits` has it."""
        room = (self.window_bytes - self.in_flight_bytes) // kernel_bytes(size)
        return max(room, 0 if self._in_flight else 1)

    def flights(self, msg_type: int, topic: str) -> Optional[List[Flight]]:
        """Return what is in flight, oldest first; None where another topic's is among it."""
        found = []
        for flight in self._in_flight:
            if flight.message[:2] != (msg_type, topic):
                return None
            found.append(flight.row)
        return found

    def _pop(self, count: int) -> None:
        self._count -= count
        while count:
            flight = self._in_flight[0]
            popped = min(count, flight.count)
            cost, is_left = flight.without(popped)
            self.in_flight_bytes -= cost
            count -= popped
            if not is_left:
                self._in_flight.popleft()


class Pacer:
    """One peer's flow: the window while it acknowledges, the bucket while it does not.

    A new peer is asked for a Credit, which tells how large its buffer is, before anything else;
    until then it gets one window, as large as a default receive buffer allows. Where a full window
    stands still, a Credit was lost or the peer does not get to read: it is asked again, and sent
    nothing, as what is sent beyond its buffer is lost for certain.
    """

    def __init__(self, bucket: Optional[TokenBucket] = None) -> None:
        self.window = CreditWindow()
        self.bucket = bucket if bucket is not None else TokenBucket()
        self.stalls = 0
        """How often a full window stood still, so that a Credit was asked for."""
        self._expects_credit = True
        self._patience_nanos = ANSWER_NANOS
        self._is_known = False  # a Credit came, or was asked for
        self._asked_nanos: Optional[int] = None  # since the newest Credit; first, and last
        self._asked_last_nanos = 0

    def sent(self, key: DatagramKey, size: int, now_nanos: int) -> None:
        """Take note that a datagram went out."""
        self.sent_run(key, 1, size, size, now_nanos)

    def sent_run(
        self, key: DatagramKey, count: int, size: int, last_size: int, now_nanos: int
    ) -> None:
        """Take note of `count` parts, from `key` on, that went out one after the other."""
        self.window.sent_run(key, count, size, last_size, now_nanos)
        if not self._expects_credit:
            cost = (count - 1) * kernel_bytes(size) + kernel_bytes(last_size)
            self.bucket.sent(cost, now_nanos)

    def granted(self, size: int, most: int, now_nanos: int) -> int:
        """Return how many datagrams of `size` bytes, at most `most`, may go now.

        None may before a new peer was asked for a Credit.
        """
        if self._expects_credit:
            return min(most, self.window.room(size)) if self._is_known else 0
        if not self.may_send(size, now_nanos):
            return 0
        return max(1, min(most, self.bucket.room(kernel_bytes(size), now_nanos)))

    @property
    def waits_for_credit(self) -> bool:
        """Whether the window alone decides."""
        return self._expects_credit and self._is_known

    @property
    def wants_credit(self) -> bool:
        """Whether a Credit is worth looking for: less than half of the window is free."""
        return self.window.in_flight_bytes * 2 > self.window.window_bytes

    def may_send(self, size: int, now_nanos: int) -> bool:
        """Tell whether a datagram of `size` bytes may go now."""
        if self._expects_credit:
            return self.window.fits(size)
        return self.bucket.may_send(kernel_bytes(size), now_nanos)

    def must_ask(self, size: int, now_nanos: int) -> bool:
        """Tell whether to ask for a Credit now, `asked` follows; may find that none will come."""
        if not self._expects_credit or now_nanos < self._next_ask_nanos(size):
            return False
        since_nanos = self._asked_nanos
        if since_nanos is not None and now_nanos - since_nanos >= self._patience_nanos:
            self._expects_credit = False
        return self._expects_credit

    def asked(self, key: DatagramKey, size: int, now_nanos: int) -> None:
        """Take note that a Credit was asked for, by a datagram that is acknowledged like others."""
        self.stalls += self._is_known
        self._is_known = True
        self._asked_last_nanos = now_nanos
        if self._asked_nanos is None:
            self._asked_nanos = now_nanos
        self.sent(key, size, now_nanos)

    def credited(self, key: DatagramKey, receive_buffer: int, now_nanos: int) -> None:
        """Take a Credit that came in.

        One for a datagram that is not in flight is ignored: it is late, or forged by somebody who
        does not see what is sent.
        """
        if self.window.is_in_flight(key):
            self.acknowledged(key, receive_buffer, now_nanos)

    def acknowledged(self, key: DatagramKey, receive_buffer: int, now_nanos: int) -> None:
        """Take a credit."""
        self._expects_credit = self._is_known = True
        self._patience_nanos = GIVE_UP_NANOS
        self._asked_nanos = None
        self.window.acknowledged(key, receive_buffer, now_nanos)

    def next_wake(self, size: int, now_nanos: int) -> int:
        """Return when to ask `must_ask` and `may_send` again if nothing is heard."""
        if not self._expects_credit:
            return self.bucket.next_wake(kernel_bytes(size), now_nanos)
        if self.window.fits(size):
            return now_nanos
        return int(max(now_nanos, self._next_ask_nanos(size)))

    def _next_ask_nanos(self, size: int) -> float:
        """Return when a Credit is to be asked for if `size` bytes wait and nothing is heard."""
        if not self._is_known:
            return 0
        if self.window.fits(size):
            return math.inf
        if self._asked_nanos is None:
            return self.window.moved_nanos + ASK_NANOS
        give_up_nanos = self._asked_nanos + self._patience_nanos
        return min(self._asked_last_nanos + ASK_NANOS, give_up_nanos)
