# SPDX-License-Identifier: Apache-2.0
"""A sender and a receiver joined by a simulated link: seeded loss, exact times, no sockets."""

import heapq
import itertools
import random
from collections import deque
from collections.abc import Callable
from typing import Any

from benchmarks.loss.symmetric_link import SymmetricLink
from groundlink.emulation.settings import Impairment
from services.gateway.virtual_link import RECEIVER
from udp_bridge import Message
from udp_bridge.sender.send_queue import SendQueue

MS = 1_000_000
SECOND = 1000 * MS

Loss = Callable[[int], bool]
"""Told the time, says whether this datagram is lost."""


def no_loss(now: int) -> bool:
    return False


def independent(rng: random.Random, share: float) -> Loss:
    return lambda now: rng.random() < share


def bursts(rng: random.Random, share: float, mean: float) -> Loss:
    """Gilbert-Elliott: all is lost in the bad state, whose mean length is `mean` datagrams."""
    leave = 1 / mean
    enter = share * leave / (1 - share)
    is_bad = False

    def lost(now: int) -> bool:
        nonlocal is_bad
        is_bad = rng.random() >= leave if is_bad else rng.random() < enter
        return is_bad

    return lost


class Direction:
    """One direction of a link, as `groundlink.emulation.LinkDirection` is."""

    def __init__(self, loss: Loss, delay: int) -> None:
        self.count = 0
        self._loss, self._delay = loss, delay
        self._waiting: deque[tuple[int, bytes]] = deque()

    def put(self, datagram: bytes, to: None, now: int) -> None:
        self.count += 1
        if not self._loss(now):
            self._waiting.append((now + self._delay, datagram))

    def next_due(self) -> int | None:
        return self._waiting[0][0] if self._waiting else None

    def take(self, now: int) -> tuple[int, bytes] | None:
        due = self.next_due()
        return self._waiting.popleft() if due is not None and due <= now else None


class Simulation(SymmetricLink):
    """What happens, in the order in which it happens."""

    def __init__(
        self,
        *,
        repair: Any = None,
        loss: Loss = no_loss,
        loss_back: Loss = no_loss,
        delay: int = 0,
        datagram: Any = "mtu",
    ) -> None:
        super().__init__(Impairment(), seed=0)
        self.now_nanos = 0
        self._options = (datagram, repair)
        self.restart_sender()
        self.there: Any = Direction(loss, delay)
        self.back: Any = Direction(loss_back, delay)
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()

    @property
    def delivered(self) -> list[tuple[int, Message]]:
        """When each message was delivered."""
        return [(at_nanos, message) for message, at_nanos in self.handed]

    @property
    def sent_datagrams(self) -> int:
        return int(self.there.count)

    def restart_sender(self) -> None:
        datagram, repair = self._options
        self.queue = SendQueue(RECEIVER, datagram, repair=repair)

    def at(self, when: int, what: Callable[[], None]) -> None:
        heapq.heappush(self._events, (when, next(self._order), what))

    def send_at(self, when: int, message: Message) -> None:
        self.at(when, lambda: self.queue.put(message))

    def run(self, until: int) -> None:
        while self._events and self._events[0][0] <= until:
            when, _, what = heapq.heappop(self._events)
            self.advance(when - self.now_nanos)
            what()
        self.advance(until - self.now_nanos)
