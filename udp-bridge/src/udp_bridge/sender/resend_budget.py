# SPDX-License-Identifier: Apache-2.0
"""How much a sender may send again: a share of what arrives, and a burst now and then.

Rule: in the long run resends are at most a quarter of the goodput that the receiver tells, because
on a full link they would make worse what they mend. But losses come in bursts, and few large
datagrams are lost a message at a time; so the share is judged over some seconds, by the best second
among them (after a pause the last one tells of little), and little may be sent again in any case.
What it is spent for, and when, is `resend`'s.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Tuple

from udp_bridge.wire.header import NANOS

WINDOW_S = 4
"""Within so many seconds a second's goodput may go out again: a quarter."""
BURST_BYTES = 1 << 20
"""May go out again within that time in any case, 16 of the largest datagrams, as far as so much
left in it for the first time: on a slow link resends never are more than half of all."""
GRAIN_NANOS = NANOS // 10
"""Of the time for which a goodput counts."""
LEAST_BYTES = 131_072
"""May go out again in any case, even of topics of which little leaves."""


class _Recent:
    """Bytes within the last `WINDOW_S`."""

    def __init__(self) -> None:
        self.total = 0
        self._items: Deque[Tuple[int, int]] = deque()  # when, and how many bytes

    def add(self, size: int, now_nanos: int) -> None:
        self.forget(now_nanos)
        self._items.append((now_nanos, size))
        self.total += size

    def forget(self, now_nanos: int) -> None:
        since_nanos = now_nanos - WINDOW_S * NANOS
        while self._items and self._items[0][0] <= since_nanos:
            self.total -= self._items.popleft()[1]


class Budget:
    """What may be sent again towards one destination."""

    def __init__(self) -> None:
        self._left = _Recent()
        self._spent = _Recent()
        self._told: Deque[Tuple[int, int]] = deque()  # when, and what; falling, so the best first

    def left(self, size: int, now_nanos: int) -> None:
        """Take note that a body of `size` bytes leaves for the first time."""
        self._left.add(size, now_nanos)

    def told(self, goodput: int, now_nanos: int) -> None:
        """Take the receiver's word for what arrived within a second.

        It is not believed that more arrived than was sent.
        """
        while self._told and self._told[-1][1] <= goodput:
            self._told.pop()
        if not self._told or now_nanos - self._told[-1][0] >= GRAIN_NANOS:
            self._told.append((now_nanos, goodput))
        while self._told[0][0] <= now_nanos - WINDOW_S * NANOS:
            self._told.popleft()

    def spend(self, size: int, now_nanos: int) -> bool:
        """Take `size` bytes, if they may be sent again; return whether they may."""
        self._left.forget(now_nanos)
        self._spent.forget(now_nanos)
        left, goodput = self._left.total, self._told[0][1] if self._told else 0
        most = max(min(goodput, left // WINDOW_S), min(BURST_BYTES, left), LEAST_BYTES)
        if self._spent.total + size > most:
            return False
        self._spent.add(size, now_nanos)
        return True
