# SPDX-License-Identifier: Apache-2.0
"""A sender and a receiver joined by a simulated link: seeded loss, exact times, no sockets."""

import functools
import heapq
import itertools
import random
from collections.abc import Callable
from typing import Any

from udp_bridge import Message
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.sender.send_queue import SendQueue

MS = 1_000_000
SECOND = 1000 * MS
SENDER = ("192.0.2.1", 1)
RECEIVER = ("192.0.2.2", 2)
WALL = 10**18

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


class Simulation:
    """What happens, in the order in which it happens."""

    def __init__(
        self,
        *,
        repair: Any = None,
        loss: Loss = no_loss,
        loss_back: Loss = no_loss,
        delay: int = 0,
        datagram: Any = "mtu",
        receive_buffer: int = 8 << 20,
        spacing: int = 2000,
    ) -> None:
        self.now = 0
        self.delivered: list[tuple[int, Message]] = []
        self.sent_datagrams = 0
        self.sent_types: list[int] = []
        self._options = (datagram, repair)
        self.restart_sender()
        self.inbox = Inbox(
            receive_buffer=receive_buffer,
            on_credit=lambda *_: None,
        )
        self.back = Inbox(
            receive_buffer=receive_buffer,
            on_credit=lambda _, key, size: self.queue.flow.credited(key, size, self.now),
            on_request=lambda _, header, request: self.queue.resender.requested(
                header, request, self.now
            ),
        )
        self._loss, self._loss_back = loss, loss_back
        self._delay, self._spacing = delay, spacing
        self._free = 0
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._pump_at: int | None = None

    def restart_sender(self) -> None:
        datagram, repair = self._options
        self.queue = SendQueue(RECEIVER, datagram, repair=repair)

    def at(self, when: int, what: Callable[[], None]) -> None:
        heapq.heappush(self._events, (when, next(self._order), what))

    def send(self, when: int, message: Message) -> None:
        def put() -> None:
            self.queue.put(message)
            self._pump()

        self.at(when, put)

    def run(self, until: int) -> None:
        while self._events and self._events[0][0] <= until:
            self.now, _, what = heapq.heappop(self._events)
            what()
        self.now = until

    def _pump(self) -> None:
        if self._free > self.now:
            self._pump_later(self._free)
            return
        datagram = self.queue.take(self.now)
        if datagram is None:
            wake = self.queue.next_wake(self.now)
            if wake is not None:
                self._pump_later(max(wake, self.now + 1000))
            return
        self.sent_datagrams += 1
        self.sent_types.append(datagram.header[0])
        self._free = self.now + self._spacing
        self._pump_later(self._free)
        if not self._loss(self.now):
            data = datagram.header + bytes(datagram.part)
            self.at(self.now + self._delay, lambda: self._arrive(data))

    def _pump_later(self, when: int) -> None:
        if self._pump_at is not None and self.now <= self._pump_at <= when:
            return
        self._pump_at = when

        def pump() -> None:
            if self._pump_at == self.now:
                self._pump_at = None
                self._pump()

        self.at(when, pump)

    def _arrive(self, data: bytes) -> None:
        message, credit = self.inbox.receive(memoryview(data), SENDER, self.now)
        if message is not None:
            self.delivered.append((self.now, message))
        answers = self.inbox.requests(self.now)
        for answer in [*answers, *([credit] if credit else [])]:
            if not self._loss_back(self.now):
                self.at(self.now + self._delay, functools.partial(self._return, answer[0]))

    def _return(self, data: bytes) -> None:
        self.back.receive(memoryview(data), RECEIVER, self.now)
        self._pump()
