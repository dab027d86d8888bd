# SPDX-License-Identifier: Apache-2.0
"""One direction of an emulated link: datagrams and time in, datagrams and delivery times out.

Random effects on a datagram depend only on seed, direction, index and settings, not on its time.
Rate, queue and outages depend on time. Every datagram and every copy counts under exactly one
outcome: datagrams + duplicated = lost + outage + rate_limited + corrupted + overflow + delivered +
waiting.
"""

import hashlib
import heapq
import math
import random
import struct
from typing import Generic, NamedTuple, TypeVar

from .settings import Impairment

T = TypeVar("T")

WAITING_BYTES = 64 << 20
"""Limit of bytes in flight; each datagram counts `OVERHEAD_BYTES` more."""

OVERHEAD_BYTES = 256
OUTCOMES = ("lost", "outage", "rate_limited", "corrupted", "overflow", "delivered")
"""Outcomes of datagrams and copies that are no longer in flight."""

NOTES = ("delayed", "reordered", "flipped")
"""Additional counts of datagrams in flight or delivered: delayed, out of order, with bit errors."""

_NANOS_PER_MS = 1_000_000
_DRAWS = struct.Struct("<8Q")
_LOSS, _DUPLICATE, _CORRUPT, _FLIPS, _JITTER, _REORDER, _JITTER_2, _REORDER_2 = range(8)


class DirectionState(NamedTuple):
    """State of the random process of a direction; determines the next outcome, except for time."""

    datagrams: int
    in_burst: bool


class LinkDirection(Generic[T]):
    """One direction of a link.

    Parameters
    ----------
    seed, direction
        key of the randomness; the two directions of a link have different names.
    flips
        whether to deliver a datagram with bit errors with flipped bits. Otherwise it is dropped,
        as by the checksum of UDP (which lets 1 in 65,536 pass; this lets none pass).
    """

    def __init__(
        self, settings: Impairment, *, seed: int, direction: str, flips: bool = False
    ) -> None:
        self.settings = settings
        """May be replaced at any time; applies to later datagrams."""

        self.counts = dict.fromkeys(("datagrams", "duplicated", *OUTCOMES, *NOTES), 0)
        self.waiting_bytes = 0
        self._state = hashlib.blake2b(f"{seed}/{direction}".encode(), digest_size=64)
        self._flips = flips
        self._index = 0
        self._in_burst = False
        self._busy_until_nanos = 0.0  # when the last queued datagram leaves the queue
        self._last_due_nanos = 0
        self._waiting: list[tuple[int, int, bytes, T]] = []
        self._order = 0

    @property
    def waiting(self) -> int:
        """Number of datagrams in flight."""
        return len(self._waiting)

    @property
    def state(self) -> DirectionState:
        """State of the random process, without datagrams in flight."""
        return DirectionState(self._index, self._in_burst)

    @state.setter
    def state(self, state: DirectionState) -> None:
        self._index, self._in_burst = state

    def next_due(self) -> int | None:
        """Return the delivery time of the next datagram; None without datagrams in flight."""
        return self._waiting[0][0] if self._waiting else None

    def put(self, datagram: bytes, tag: T, now_nanos: int) -> None:
        """Send a datagram.

        Parameters
        ----------
        tag
            returned with the datagram, such as its destination.
        now_nanos
            time of a monotonic clock.
        """
        self.counts["datagrams"] += 1
        draws = self._draws(self._index)
        self._index += 1
        is_lost = self._is_lost(draws[_LOSS])
        settings = self.settings
        if settings.outage:
            self.counts["outage"] += 1
            return
        sent_nanos = self._on_the_wire(len(datagram), now_nanos)
        if sent_nanos is None:
            self.counts["rate_limited"] += 1
            return
        if is_lost:
            self.counts["lost"] += 1
            return
        if settings.bit_errors and (at := self._first_error(draws[_CORRUPT])) < 8 * len(datagram):
            if not self._flips:
                self.counts["corrupted"] += 1
                return
            datagram = self._flipped(datagram, at, draws[_FLIPS])
            self.counts["flipped"] += 1
        is_twice = draws[_DUPLICATE] < settings.duplicate
        self._deliver_later(datagram, tag, now_nanos, sent_nanos, draws[_JITTER], draws[_REORDER])
        if is_twice:
            self.counts["duplicated"] += 1
            later = draws[_JITTER_2], draws[_REORDER_2]
            self._deliver_later(datagram, tag, now_nanos, sent_nanos, *later)

    def take(self, now_nanos: int) -> tuple[int, bytes, T] | None:
        """Return the next due datagram: delivery time, bytes and tag; None if none is due."""
        if not self._waiting or self._waiting[0][0] > now_nanos:
            return None
        due_nanos, _, datagram, tag = heapq.heappop(self._waiting)
        self.waiting_bytes -= len(datagram) + OVERHEAD_BYTES
        self.counts["delivered"] += 1
        return due_nanos, datagram, tag

    def _draws(self, index: int) -> list[float]:
        """Return eight numbers in [0, 1) for one datagram: BLAKE2b as a counter-based RNG."""
        state = self._state.copy()
        state.update(index.to_bytes(8, "little"))
        # Use 53 bits so that no value rounds up to 1.
        return [(number >> 11) * 2.0**-53 for number in _DRAWS.unpack(state.digest())]

    def _is_lost(self, draw: float) -> bool:
        settings = self.settings
        if not settings.burst:
            self._in_burst = False
            return draw < settings.loss
        if self._in_burst:
            self._in_burst = draw >= 1 / settings.burst
        else:
            self._in_burst = draw < settings.chance_of_burst()
        return self._in_burst

    def _on_the_wire(self, size: int, now_nanos: int) -> int | None:
        """Return when a datagram leaves the queue of the rate limit; None if the queue is full."""
        settings = self.settings
        if not settings.rate_mbps:
            self._busy_until_nanos = 0.0
            return now_nanos
        nanos_per_byte = 8000 / settings.rate_mbps
        start = max(now_nanos, self._busy_until_nanos)
        waiting_bytes = (start - now_nanos) / nanos_per_byte
        if waiting_bytes and waiting_bytes + size > settings.queue_kb * 1000:
            return None
        self._busy_until_nanos = start + size * nanos_per_byte
        return math.ceil(self._busy_until_nanos)

    def _first_error(self, draw: float) -> int:
        """Return the index of the first bit error; geometrically distributed."""
        probability = self.settings.bit_errors
        if probability == 1:
            return 0
        return int(min(math.log1p(-draw) / math.log1p(-probability), 2.0**32))

    def _flipped(self, datagram: bytes, at: int, draw: float) -> bytes:
        """Return a copy with bit `at` and random later bits inverted."""
        further = random.Random(int(draw * 2**53))
        wrong = bytearray(datagram)
        while at < 8 * len(wrong):
            wrong[at // 8] ^= 1 << at % 8
            at += 1 + self._first_error(further.random())
        return bytes(wrong)

    def _deliver_later(
        self, datagram: bytes, tag: T, now_nanos: int, sent_nanos: int, jitter: float, order: float
    ) -> None:
        settings = self.settings
        size = len(datagram) + OVERHEAD_BYTES
        if self.waiting_bytes + size > WAITING_BYTES:
            self.counts["overflow"] += 1
            return
        delay_ms = settings.delay_ms + jitter * settings.jitter_ms
        due_nanos = max(sent_nanos + round(delay_ms * _NANOS_PER_MS), self._last_due_nanos)
        if order < settings.reorder:
            due_nanos += round(settings.reorder_ms * _NANOS_PER_MS)
            self.counts["reordered"] += 1
        else:
            self._last_due_nanos = due_nanos
        self.counts["delayed"] += due_nanos > now_nanos
        self.waiting_bytes += size
        heapq.heappush(self._waiting, (due_nanos, self._order, datagram, tag))
        self._order += 1
