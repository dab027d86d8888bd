# SPDX-License-Identifier: Apache-2.0
"""Flow control towards one peer: a credit window if the peer sends Credits, else a token bucket.

Times are nanoseconds of one monotonic clock. Only datagrams of multi-part messages, resends and
repair data are counted; single-part messages are few and small, and are sent at once.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, List, Optional, Tuple

from udp_bridge.wire.header import NANOS
from udp_bridge.wire.message import DatagramKey

BATCH_BYTES = 1 << 21
"""Most bytes of a batch. A small message waits for at most one batch, about 0.2 ms."""
DATAGRAM_OVERHEAD = 1024
ROUNDED_UP_TO = 16384
WINDOW_SHARE = 2
"""The window is the peer's receive buffer divided by this. The kernel frees memory late: while a
buffer is read, only three quarters of it are usable."""
REQUEST_NANOS = 10_000_000
"""A Credit is requested when a full window has not moved for this long, and then again."""
FIRST_CREDIT_NANOS = 50_000_000
"""Time in which a new peer has to send its first Credit."""
GIVE_UP_NANOS = NANOS
"""A peer that sent Credits before is assumed to send none after this time of vain requests."""
DEFAULT_RECEIVE_BUFFER = 212992
"""Linux's default receive buffer, assumed of a peer until its first Credit."""
TRACKED_DATAGRAMS = 4096
"""Most datagrams that are tracked as in flight. Half of 8 MiB hold fewer, even of 256 bytes."""
DEFAULT_RATE_BYTES_PER_S = 50e6
"""Rate of the token bucket, in kernel bytes like the burst."""
DEFAULT_BURST_BYTES = 133120
"""Two of the largest datagrams. Three quarters of a default receive buffer are 159,744 bytes."""

InFlight = Tuple[int, int, int, int, int]
"""Consecutive parts in flight: seq_number, first part, count, kernel bytes of each part and of the
last one."""


def kernel_bytes(size: int) -> int:
    """Return an upper estimate of the receive-buffer bytes that a datagram takes.

    Measured on loopback with Linux 6.18: up to 16 KiB the kernel rounds up to a power of two (2305
    bytes for 1472, 16,644 for 8192 and 9000); above, it adds little (17,225 for 16,384, 66,576 for
    65,507).
    """
    rounding = size if size <= ROUNDED_UP_TO else 0
    return size + rounding + DATAGRAM_OVERHEAD


class TokenBucket:
    """Limits the mean rate and the burst towards a peer that sends no Credits."""

    def __init__(
        self,
        rate_bytes_per_s: float = DEFAULT_RATE_BYTES_PER_S,
        burst_bytes: int = DEFAULT_BURST_BYTES,
    ) -> None:
        self.rate_bytes_per_s = rate_bytes_per_s
        self.burst_bytes = burst_bytes
        self._tokens = float(burst_bytes)
        self._filled_nanos: Optional[int] = None

    def sent(self, size: int, now_nanos: int) -> None:
        """Subtract the bytes of a datagram that was sent."""
        self._fill(now_nanos)
        self._tokens -= size

    def may_send(self, size: int, now_nanos: int) -> bool:
        """Return whether a datagram of `size` bytes may be sent now."""
        self._fill(now_nanos)
        return self._tokens >= min(size, self.burst_bytes)

    def next_wake(self, size: int, now_nanos: int) -> int:
        """Return when the bucket holds enough for `size` bytes."""
        self._fill(now_nanos)
        wanted = min(size, self.burst_bytes) - self._tokens
        return now_nanos + max(0, int(wanted / self.rate_bytes_per_s * NANOS) + 1)

    def room(self, size: int, now_nanos: int) -> int:
        """Return for how many datagrams of `size` bytes there are tokens."""
        self._fill(now_nanos)
        return max(0, int(self._tokens // size))

    def _fill(self, now_nanos: int) -> None:
        if self._filled_nanos is not None:
            gained = (now_nanos - self._filled_nanos) * self.rate_bytes_per_s / NANOS
            self._tokens = min(self.burst_bytes, self._tokens + gained)
        self._filled_nanos = now_nanos


class _PartRange:
    """Consecutive parts of one message in flight; only the last may be smaller."""

    __slots__ = ("cost", "count", "first", "last_cost", "message")

    def __init__(self, key: DatagramKey, count: int, cost: int, last_cost: int) -> None:
        self.message = key[:3]
        self.first = key.part_number
        self.count = count
        self.cost = cost
        self.last_cost = last_cost

    def pop(self, count: int) -> int:
        """Remove the first `count` parts, but not all; return their kernel bytes."""
        self.first += count
        self.count -= count
        return count * self.cost


class CreditWindow:
    """Limits the bytes in the peer's receive buffer: all sent after the newest Credit."""

    def __init__(self) -> None:
        self.in_flight_bytes = 0
        """In kernel bytes, as the receiver's kernel counts them."""
        self.window_bytes = DEFAULT_RECEIVE_BUFFER // WINDOW_SHARE
        """Most kernel bytes in flight."""
        self.moved_nanos = 0
        """Time of the newest datagram or Credit."""
        self._ranges: Deque[_PartRange] = deque()
        self._count = 0

    def sent(self, key: DatagramKey, count: int, size: int, last_size: int, now_nanos: int) -> None:
        """Add `count` parts that were sent, from `key` on; sizes are bytes of datagrams."""
        cost, last_cost = kernel_bytes(size), kernel_bytes(last_size)
        newest = self._ranges[-1] if self._ranges else None
        if (
            newest is not None
            and newest.message == key[:3]
            and newest.first + newest.count == key.part_number
            and newest.cost == newest.last_cost == cost
        ):
            newest.count += count
            newest.last_cost = last_cost
        else:
            self._ranges.append(_PartRange(key, count, cost, last_cost))
        self.in_flight_bytes += (count - 1) * cost + last_cost
        self._count += count
        self.moved_nanos = now_nanos
        while self._count > TRACKED_DATAGRAMS:
            self._pop(1)

    def acknowledged(self, key: DatagramKey, receive_buffer: int, now_nanos: int) -> None:
        """Apply a Credit: free its datagram and all before it, and set the window's size."""
        self.window_bytes = receive_buffer // WINDOW_SHARE
        self.moved_nanos = now_nanos
        before, message = 0, key[:3]
        for parts in self._ranges:
            ahead = key.part_number - parts.first
            if parts.message == message and 0 <= ahead < parts.count:
                self._pop(before + ahead + 1)
                return
            before += parts.count

    def is_in_flight(self, key: DatagramKey) -> bool:
        """Return whether a datagram was sent and not acknowledged yet."""
        message = key[:3]
        return any(
            parts.message == message and 0 <= key.part_number - parts.first < parts.count
            for parts in self._ranges
        )

    def fits(self, size: int) -> bool:
        """Return whether a datagram of `size` bytes fits; one always does if none is in flight."""
        total = self.in_flight_bytes + kernel_bytes(size)
        return not self._ranges or total <= self.window_bytes

    def room(self, size: int) -> int:
        """Return how many datagrams of `size` bytes fit now."""
        room = (self.window_bytes - self.in_flight_bytes) // kernel_bytes(size)
        return max(room, 0 if self._ranges else 1)

    def in_flight(self, msg_type: int, topic: str) -> Optional[List[InFlight]]:
        """Return what is in flight, oldest first; None if other topics are among it."""
        if any(parts.message[:2] != (msg_type, topic) for parts in self._ranges):
            return None
        return [
            (parts.message[2], parts.first, parts.count, parts.cost, parts.last_cost)
            for parts in self._ranges
        ]

    def _pop(self, count: int) -> None:
        self._count -= count
        while count:
            parts = self._ranges[0]
            if count < parts.count:
                self.in_flight_bytes -= parts.pop(count)
                return
            count -= parts.count
            self.in_flight_bytes -= (parts.count - 1) * parts.cost + parts.last_cost
            self._ranges.popleft()


class FlowControl:
    """Decides how many datagrams may be sent to one peer now.

    A new peer first gets a CreditRequest, because its Credit tells the size of its buffer. Until
    then the window is that of a default receive buffer. If a full window does not move, a Credit
    was lost or the peer is not reading: the sender requests a Credit and sends nothing else, since
    anything beyond the peer's buffer is lost for certain. A peer that never answers is limited by
    the token bucket.
    """

    def __init__(self, bucket: Optional[TokenBucket] = None) -> None:
        self.window = CreditWindow()
        self.bucket = bucket if bucket is not None else TokenBucket()
        self.stalls = 0
        """Credits that were requested because a full window did not move."""
        self._expects_credit = True
        self._timeout_nanos = FIRST_CREDIT_NANOS
        self._is_known = False  # a Credit came or was requested
        self._first_request_nanos: Optional[int] = None  # since the newest Credit
        self._last_request_nanos = 0

    def sent(self, key: DatagramKey, count: int, size: int, last_size: int, now_nanos: int) -> None:
        """Count `count` parts that were sent, from `key` on; sizes are bytes of datagrams."""
        self.window.sent(key, count, size, last_size, now_nanos)
        if not self._expects_credit:
            cost = (count - 1) * kernel_bytes(size) + kernel_bytes(last_size)
            self.bucket.sent(cost, now_nanos)

    def allowed(self, size: int, most: int, now_nanos: int) -> int:
        """Return how many datagrams of `size` bytes, at most `most`, may be sent now.

        It is 0 before a Credit was requested of a new peer.
        """
        if self._expects_credit:
            return min(most, self.window.room(size)) if self._is_known else 0
        if not self.may_send(size, now_nanos):
            return 0
        return max(1, min(most, self.bucket.room(kernel_bytes(size), now_nanos)))

    @property
    def is_window_in_use(self) -> bool:
        """Whether the credit window alone decides."""
        return self._expects_credit and self._is_known

    @property
    def is_mostly_used(self) -> bool:
        """Whether less than half of the window is free."""
        return self.window.in_flight_bytes * 2 > self.window.window_bytes

    def may_send(self, size: int, now_nanos: int) -> bool:
        """Return whether a datagram of `size` bytes may be sent now."""
        if self._expects_credit:
            return self.window.fits(size)
        return self.bucket.may_send(kernel_bytes(size), now_nanos)

    def is_request_due(self, size: int, now_nanos: int) -> bool:
        """Return whether to request a Credit now; `requested` must follow.

        After too many vain requests it switches to the token bucket and returns False.
        """
        if not self._expects_credit or now_nanos < self._next_request_nanos(size):
            return False
        since_nanos = self._first_request_nanos
        if since_nanos is not None and now_nanos - since_nanos >= self._timeout_nanos:
            self._expects_credit = False
        return self._expects_credit

    def requested(self, key: DatagramKey, size: int, now_nanos: int) -> None:
        """Count a CreditRequest of `size` bytes, which is acknowledged like any datagram."""
        self.stalls += self._is_known
        self._is_known = True
        self._last_request_nanos = now_nanos
        if self._first_request_nanos is None:
            self._first_request_nanos = now_nanos
        self.sent(key, 1, size, size, now_nanos)

    def credited(self, key: DatagramKey, receive_buffer: int, now_nanos: int) -> None:
        """Apply a Credit that was received.

        A Credit for a datagram that is not in flight is ignored: it is late, or forged by someone
        who does not see the traffic.
        """
        if self.window.is_in_flight(key):
            self.acknowledged(key, receive_buffer, now_nanos)

    def acknowledged(self, key: DatagramKey, receive_buffer: int, now_nanos: int) -> None:
        """Apply a Credit without checking it."""
        self._expects_credit = self._is_known = True
        self._timeout_nanos = GIVE_UP_NANOS
        self._first_request_nanos = None
        self.window.acknowledged(key, receive_buffer, now_nanos)

    def next_wake(self, size: int, now_nanos: int) -> int:
        """Return when to call `is_request_due` and `may_send` again if no Credit comes."""
        if not self._expects_credit:
            return self.bucket.next_wake(kernel_bytes(size), now_nanos)
        if self.window.fits(size):
            return now_nanos
        return int(max(now_nanos, self._next_request_nanos(size)))

    def _next_request_nanos(self, size: int) -> float:
        """Return when to request a Credit if `size` bytes wait and no Credit comes."""
        if not self._is_known:
            return 0
        if self.window.fits(size):
            return math.inf
        if self._first_request_nanos is None:
            return self.window.moved_nanos + REQUEST_NANOS
        give_up_nanos = self._first_request_nanos + self._timeout_nanos
        return min(self._last_request_nanos + REQUEST_NANOS, give_up_nanos)
