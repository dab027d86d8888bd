# SPDX-License-Identifier: Apache-2.0
"""Relay that loses and repeats datagrams both ways and counts what it passes on.

A seeded generator decides about each datagram; none is delayed or reordered. The counts are the
reference for the sender's delivery counts.
"""

import random
import select
import socket
import threading
from collections import Counter, OrderedDict
from dataclasses import dataclass, field

from udp_bridge.wire.header import Refused, parse
from udp_bridge.wire.types import MSG_TYPES

_Key = tuple[int, str]
_MAX_OPEN = 2048
"""Messages of all topics that may still get parts: some seconds' worth, as a message of many parts
may take that long on a busy machine."""


@dataclass
class ReferenceCounts:
    """Actual outcome of the messages of one incarnation of the sender, by type and topic."""

    sent: Counter[_Key] = field(default_factory=Counter)
    whole: Counter[_Key] = field(default_factory=Counter)
    partial: Counter[_Key] = field(default_factory=Counter)
    delivered: Counter[_Key] = field(default_factory=Counter)
    seen: set[int] = field(default_factory=set)
    """Messages that were delivered, by the number in their body."""
    receivers: int = 0
    """Restarts of the receiver in this incarnation."""
    crashes: int = 0
    """Restarts without last reports."""


class LossyRelay:
    """Passes datagrams on between a sender and a receiver, with loss and duplicates."""

    def __init__(
        self, receiver: tuple[str, int], seed: int, *, loss: float, duplicates: float
    ) -> None:
        self._loss, self._duplicates = loss, duplicates
        self._random = random.Random(seed)
        self._receiver = receiver
        self._sender: tuple[str, int] | None = None
        self.front, self.back = (self._bound() for _ in range(2))
        self.lost = self.repeated = 0
        self._reference = ReferenceCounts()
        self._open: OrderedDict[tuple[int, str, int], tuple[int, set[int]]] = OrderedDict()
        self._lock = threading.Lock()
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def reset(self, reference: ReferenceCounts) -> None:
        """Count for a new incarnation of the sender."""
        with self._lock:
            self._reference = reference
            self._open.clear()

    def settle(self) -> None:
        """Record unfinished messages."""
        with self._lock:
            self._settle(0)

    def close(self) -> None:
        """End the thread and close the sockets."""
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
                    continue  # an ICMP error
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
            self._record(datagram, is_lost=is_lost)
        for _ in range(copies):
            try:
                end.sendto(datagram, to)
            except OSError:
                pass  # no process listens at the moment

    def _record(self, datagram: bytes, *, is_lost: bool) -> None:
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
            self._settle(_MAX_OPEN)

    def _settle(self, kept: int) -> None:
        while len(self._open) > kept:
            (msg_type, topic, _), (parts, passed) = self._open.popitem(last=False)
            self._reference.whole[msg_type, topic] += len(passed) == parts
            self._reference.partial[msg_type, topic] += 0 < len(passed) < parts
