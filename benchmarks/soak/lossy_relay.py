# SPDX-License-Identifier: Apache-2.0
"""A relay that loses and repeats datagrams both ways and keeps books of what it let through.

Rule: every datagram is judged alone, by a seeded generator; nothing is delayed or reordered. The
books are the truth that a sender's accounts are compared with.
"""

from __future__ import annotations

import random
import select
import socket
import threading
from collections import Counter, OrderedDict
from dataclasses import dataclass, field

from udp_bridge.wire.header import Refused, parse
from udp_bridge.wire.types import MSG_TYPES

_Key = tuple[int, str]
_UNDER_WAY = 2048
"""Messages of all topics that may still get parts: those of some seconds, for on a busy machine a
message of many parts may take as long."""


@dataclass
class Books:
    """What really happened to the messages of one life of the sender, by type and topic."""

    sent: Counter[_Key] = field(default_factory=Counter)
    whole: Counter[_Key] = field(default_factory=Counter)
    partial: Counter[_Key] = field(default_factory=Counter)
    delivered: Counter[_Key] = field(default_factory=Counter)
    seen: set[int] = field(default_factory=set)
    """Messages that were delivered, by the number in their body."""
    receivers: int = 0
    """Restarts of the receiver in this life."""
    crashes: int = 0
    """Those in which it had no last word."""


class Relay:
    """Passes datagrams on between one sender and one receiver, some of them not, some twice."""

    def __init__(
        self, receiver: tuple[str, int], seed: int, *, loss: float, duplicates: float
    ) -> None:
        self._loss, self._duplicates = loss, duplicates
        self._random = random.Random(seed)
        self._receiver = receiver
        self._sender: tuple[str, int] | None = None
        self.front, self.back = (self._bound() for _ in range(2))
        self.lost = self.repeated = 0
        self._books = Books()
        self._open: OrderedDict[tuple[int, str, int], tuple[int, set[int]]] = OrderedDict()
        self._lock = threading.Lock()
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def new_life(self, books: Books) -> None:
        """Begin new books, for the sender is a new one."""
        with self._lock:
            self._books = books
            self._open.clear()

    def settle(self) -> None:
        """Write down what was under way."""
        with self._lock:
            self._settle(0)

    def close(self) -> None:
        """End the thread and give the sockets back."""
        self._is_closed = True
        self._thread.join()
        self.front.close()
        self.back.close()

    def _bound(self) -> socket.socket:
        bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        bound.bind(("127.0.0.1", 0))
        bound.setblocking(False)
        return bound

    def _run(self) -> None:
        while not self._is_closed:
            ready, _, _ = select.select([self.front, self.back], [], [], 0.1)
            for end in ready:
                try:
                    datagram, source = end.recvfrom(65536)
                except OSError:
                    continue  # what a closed end's host answers
                if end is self.front:
                    self._sender = source
                    self._pass(datagram, self.back, self._receiver, is_data=True)
                elif self._sender is not None:
                    self._pass(datagram, self.front, self._sender, is_data=False)

    def _pass(
        self, datagram: bytes, end: socket.socket, to: tuple[str, int], *, is_data: bool
    ) -> None:
        is_lost = self._random.random() < self._loss
        copies = 0 if is_lost else 1 + (self._random.random() < self._duplicates)
        self.lost += is_lost
        self.repeated += copies == 2
        if is_data:
            self._write_down(datagram, is_lost=is_lost)
        for _ in range(copies):
            try:
                end.sendto(datagram, to)
            except OSError:
                pass  # nobody is there at the moment

    def _write_down(self, datagram: bytes, *, is_lost: bool) -> None:
        try:
            header, _ = parse(datagram)
        except Refused:
            return
        if not MSG_TYPES[header.msg_type].ros_type:
            return
        with self._lock:
            key = (header.msg_type, header.topic, header.seq_number)
            _, passed = self._open.setdefault(key, (header.parts_max, set()))
            if not is_lost:
                passed.add(header.part_number)
            self._settle(_UNDER_WAY)

    def _settle(self, kept: int) -> None:
        while len(self._open) > kept:
            (msg_type, topic, _), (parts, passed) = self._open.popitem(last=False)
            self._books.whole[msg_type, topic] += len(passed) == parts
            self._books.partial[msg_type, topic] += 0 < len(passed) < parts
