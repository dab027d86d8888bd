# SPDX-License-Identifier: Apache-2.0
"""The sending half of a link: who sends when, in the thread that brings a message or in ours.

One thread at a time sends what waits in the outboxes; credits and requests come in here. What goes
next, and how much of it, is decided in `sending` and `flow`.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Dict, List, Optional

from .control import TopicReport
from .flow import DatagramKey
from .fragments import DatagramSize
from .header import NANOS, Header
from .repair import RepairTable
from .repair_wire import Request
from .sending import Address, Datagram, Outbox, take_in_turn
from .udp_socket import DatagramSocket, resolve

_AT_ONCE_BYTES = 1 << 21
"""What the thread that calls `send` sends itself; ours sends the rest."""
_RUN_BYTES = 1 << 19
"""What is sent at once at most; small messages, which go first, wait for no more than that."""


class Departures:
    """What `Link` has for sending; made before its socket, which is given by `_departs_by`."""

    _socket: DatagramSocket

    def __init__(self, datagram: DatagramSize, *, signed_peer: bool, repair: RepairTable) -> None:
        self._datagram = datagram
        self._signed_peer = signed_peer
        self._repair = repair
        self._overhead = 0
        self._large_waiting = 0
        lock = threading.RLock()  # guards all of the sending side
        self._wake = threading.Condition(lock)  # of the thread that sends
        self._idle = threading.Condition(lock)  # of those who wait until all is sent
        self._routes: Dict[Address, Outbox] = {}  # by address as it was given
        self._outboxes: Dict[Address, Outbox] = {}  # by numeric address
        self._turn: List[Outbox] = []
        self._is_sending = False
        self._is_closed = False
        self._sent = {"sent_messages": 0, "sent_datagrams": 0, "sent_bytes": 0}
        self._send_run: Any = None
        self._run_bytes = 0

    def _departs_by(self, socket: DatagramSocket) -> None:
        # What stands around a socket may lack this; then each datagram goes by itself.
        self._send_run = getattr(socket, "send_run", None)
        self._run_bytes = _RUN_BYTES if self._send_run is not None else 0

    def _outbox(self, to: Address) -> Outbox:
        outbox = self._routes.get(to)
        if outbox is None:
            numeric = resolve(to)
            outbox = self._outboxes.get(numeric)
            if outbox is None:
                outbox = Outbox(
                    numeric,
                    self._datagram,
                    signed_peer=self._signed_peer,
                    repair=self._repair,
                    reserve=self._overhead,
                    large_waiting=self._large_waiting,
                )
                self._outboxes[numeric] = outbox
                self._turn.append(outbox)
            self._routes[to] = outbox
        return outbox

    def _credited(self, sender: Address, key: DatagramKey, receive_buffer: int) -> None:
        with self._wake:
            outbox = self._outboxes.get(sender)
            if outbox is not None:
                outbox.pacer.acknowledged(key, receive_buffer, time.monotonic_ns())
                if not outbox.is_idle:
                    self._wake.notify_all()

    def _requested(self, sender: Address, header: Header, request: Request) -> None:
        with self._wake:
            outbox = self._outboxes.get(sender)
            if outbox is not None:
                outbox.resender.asked(header, request, time.monotonic_ns())
                self._wake.notify_all()

    def _reported(self, sender: Address, topic: str, report: TopicReport, told_nanos: int) -> None:
        with self._wake:
            outbox = self._outboxes.get(sender)
            if outbox is not None:
                outbox.accounts.reported(topic, report, told_nanos)

    def _answer(self, answer: bytes, to: Address) -> None:
        is_sent = self._socket.send([answer], to)
        with self._wake:
            self._count_sent(len(answer), int(is_sent), is_last=is_sent)

    def _send_loop(self) -> None:
        while True:
            with self._wake:
                datagram = self._take()
                while datagram is None and not self._is_closed:
                    self._wake.wait(None if self._is_sending else self._wait_s())
                    datagram = self._take()
                if datagram is None or self._is_closed:
                    return
            self._send(datagram)

    def _send_at_once(self) -> None:
        """Send what may go now, in the thread that brought it: waking ours would take longer."""
        left_bytes = _AT_ONCE_BYTES
        while left_bytes > 0:
            with self._wake:
                datagram = None if self._is_closed else self._take()
                if datagram is None:
                    break
            left_bytes -= self._send(datagram)
        with self._wake:
            if not self._is_sending and not self._is_idle():
                self._wake.notify_all()

    def _take(self) -> Optional[Datagram]:
        """Return what to send now, unless another thread is sending; `_send` must follow."""
        if self._is_sending:
            return None
        datagram = take_in_turn(self._turn, time.monotonic_ns(), self._run_bytes)
        self._is_sending = datagram is not None
        return datagram

    def _send(self, datagram: Datagram) -> int:
        run = datagram.run
        count, size = 1, len(datagram.header) + datagram.part.nbytes
        if run is not None:
            sent = self._send_run(run, datagram.to)
            count = run.parts_count
            size = run.size if sent == count else sent * size
        else:
            sent = int(self._socket.send([datagram.header, datagram.part], datagram.to))
        with self._wake:
            self._is_sending = False
            self._count_sent(size, sent, is_last=datagram.is_last and sent == count)
            if self._is_idle():
                self._idle.notify_all()
        return size

    def _wait_s(self) -> Optional[float]:
        now_nanos = time.monotonic_ns()
        wakes = [outbox.next_wake(now_nanos) for outbox in self._turn]
        waiting = [wake for wake in wakes if wake is not None]
        return max(0, min(waiting) - now_nanos) / NANOS if waiting else None

    def _is_idle(self) -> bool:
        if self._is_closed:
            return True
        return not self._is_sending and all(outbox.is_idle for outbox in self._turn)

    def _count_sent(self, size: int, datagrams: int, *, is_last: bool) -> None:
        if datagrams:
            self._sent["sent_datagrams"] += datagrams
            self._sent["sent_bytes"] += size
            self._sent["sent_messages"] += is_last
