# SPDX-License-Identifier: Apache-2.0
"""The sending half of a link: who sends when, in the thread that brings a message or in ours.

One thread at a time sends. Who finds another one sending leaves what he has to that one, and who
has sent looks whether anything was left to him; our thread is woken only for what has to wait, as
for a credit or an offer. Credits and requests come in here. What goes next, and how much of it, is
decided in `sending` and `flow`.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Union

from udp_bridge.sender.credit_window import ASK_NANOS
from udp_bridge.sender.outgoing import Datagram
from udp_bridge.sender.pending import WaitingTable
from udp_bridge.sender.repair import Mode, RepairTable
from udp_bridge.sender.send_queue import Outbox
from udp_bridge.wire.address_validation import AddressChallenge, AddressResponse
from udp_bridge.wire.control import TopicReport
from udp_bridge.wire.fragments import DatagramSize
from udp_bridge.wire.header import NANOS, Buffer, Header
from udp_bridge.wire.message import Address, DatagramKey, TopicKey
from udp_bridge.wire.repair import Request
from udp_bridge.wire.types import CONTROL

from .credit_mailbox import NoParking, Parking
from .udp_socket import DatagramSocket, resolve

AT_ONCE_BYTES = 1 << 24
"""What the thread that calls `send` sends itself: the largest message or nearly all of it, for to
hand the rest over to ours costs a fifth of the throughput at 16 MB."""
_RUN_BYTES = 1 << 21
"""What is sent at once at most; small messages, which go first, wait for no more than that, about
0.2 ms."""


class Departures:
    """What `Link` has for sending; made before its socket, which is given by `_departs_by`."""

    _socket: DatagramSocket

    def __init__(self, datagram: DatagramSize, *, signed_peer: bool, repair: RepairTable) -> None:
        self._datagram = datagram
        self._signed_peer = signed_peer
        self._repair: Dict[TopicKey, Mode] = dict(repair)
        self._overhead = 0
        self._large_waiting: Optional[WaitingTable] = None
        self._lock = threading.RLock()  # guards all of the sending side
        self._wake = threading.Condition(self._lock)  # of the thread that sends
        self._idle = threading.Condition(self._lock)  # of those who wait until all is sent
        self._idle_waiters = 0
        self._routes: Dict[Address, Outbox] = {}  # by address as it was given
        self._outboxes: Dict[Address, Outbox] = {}  # by numeric address
        self._turn: List[Outbox] = []
        self._is_sending = False
        self._is_relied_on = False  # somebody left something to the one who is sending
        self._sleeps_until_nanos = 0.0  # our thread; 0 while it is awake
        self._is_watching = False  # something waited lately: our thread looks again before long
        self._is_closed = False
        self._vouch: Callable[[Address], object] = _ask_nobody
        self._sent = {"sent_messages": 0, "sent_datagrams": 0, "sent_bytes": 0}
        self._send_run: Any = None
        self._run_bytes = 0
        self._parking: Union[Parking, NoParking] = NoParking()

    def _departs_by(self, socket: DatagramSocket) -> None:
        # What stands around a socket may lack this; then each datagram goes by itself.
        self._send_run = getattr(socket, "send_run", None)
        self._run_bytes = _RUN_BYTES if self._send_run is not None else 0
        if hasattr(socket, "park_credits"):
            self._parking = Parking(socket, self._sent)

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
                self._vouch(numeric)
                self._turn.append(outbox)
            self._routes[to] = outbox
        return outbox

    def _credited(self, sender: Address, key: DatagramKey, receive_buffer: int) -> None:
        with self._wake:
            outbox = self._outboxes.get(sender)
            if outbox is None:
                return
            now_nanos = time.monotonic_ns()
            self._parking.collect(now_nanos, waits=True)  # they came before this one
            outbox.pacer.credited(key, receive_buffer, now_nanos)
            if outbox.is_idle:
                return
            if self._datagram != "loopback":
                self._wake.notify_all()
                return
        # On one host to send is to copy, which takes less time than to wake our thread; over a
        # wire it may wait, and what comes in meanwhile would, too.
        self._send_at_once(_RUN_BYTES)

    def _requested(self, sender: Address, header: Header, request: Request) -> None:
        with self._wake:
            outbox = self._outboxes.get(sender)
            if outbox is not None:
                now_nanos = time.monotonic_ns()
                self._parking.collect(now_nanos, waits=True)  # it may be of what was sent there
                outbox.resender.asked(header, request, now_nanos)
        self._send_at_once(_RUN_BYTES)

    def _challenged(self, sender: Address, challenge: AddressChallenge) -> None:
        with self._lock:
            if sender not in self._outboxes:
                return  # nothing goes there, so nobody there needs to know that we are here
        response = Header(CONTROL, 0, 0, 1, 0, 0).pack() + AddressResponse(challenge.cookie).pack()
        self._answer(response, sender)

    def _order_is_over(self) -> None:
        with self._lock:
            now_nanos = time.monotonic_ns()
            self._parking.collect(now_nanos, waits=True)
            if self._is_idle() and self._next_wake(now_nanos) > now_nanos:  # not even an offer
                if self._idle_waiters:
                    self._idle.notify_all()
                return
        self._send_at_once(_RUN_BYTES)

    def _reported(self, sender: Address, topic: str, report: TopicReport, told_nanos: int) -> None:
        with self._wake:
            outbox = self._outboxes.get(sender)
            if outbox is not None:
                outbox.accounts.reported(topic, report, told_nanos)

    def _answer(self, answer: bytes, to: Address) -> None:
        is_sent = self._socket.send([answer], to)
        with self._lock:
            self._count_sent(len(answer), int(is_sent), is_last=is_sent)

    def _send_turn(self) -> bool:
        """Send what waits, or wait until something may go; return False after `close`."""
        with self._wake:
            if self._is_closed:
                return False
            datagram = self._take()
            if datagram is None:
                self._sleep()
                return True
        self._send(datagram)
        return True

    def _sleep(self) -> None:
        """Wait, in our thread, until something may go; the one who is sending sees to the rest."""
        now_nanos = time.monotonic_ns()
        self._sleeps_until_nanos = math.inf if self._is_sending else self._next_wake(now_nanos)
        if self._is_watching:  # to be woken for each full window would take longer
            self._sleeps_until_nanos = min(self._sleeps_until_nanos, now_nanos + ASK_NANOS)
            self._is_watching = False
        if self._idle_waiters:
            self._idle.notify_all()  # what went stale while it waited needs no sending any more
        wait_nanos = self._sleeps_until_nanos - now_nanos
        self._wake.wait(None if wait_nanos == math.inf else max(0.0, wait_nanos) / NANOS)
        self._sleeps_until_nanos = 0.0

    def _send_at_once(self, most_bytes: int) -> None:
        """Send what may go now, in the thread that brought it: waking ours would take longer."""
        left_bytes = most_bytes
        while left_bytes > 0:
            with self._lock:
                datagram = None if self._is_closed else self._take()
                if datagram is None:
                    break
            left_bytes -= self._send(datagram)
        with self._lock:
            if self._is_sending:
                self._is_relied_on = True
            elif self._sleeps_until_nanos:
                now_nanos = time.monotonic_ns()
                if left_bytes <= 0:
                    self._parking.collect(now_nanos, waits=True)  # nobody sends any more
                    self._parking.order()
                next_wake_nanos = self._next_wake(now_nanos)
                self._is_watching |= next_wake_nanos < math.inf
                if next_wake_nanos < self._sleeps_until_nanos:
                    self._wake.notify_all()

    def _take(self) -> Optional[Datagram]:
        """Return what to send now, unless another thread is sending; `_send` must follow."""
        self._is_relied_on = self._is_sending
        if self._is_sending:
            return None
        now_nanos = time.monotonic_ns()
        self._parking.collect(now_nanos, waits=False)
        datagram = take_in_turn(self._turn, now_nanos, self._run_bytes)
        if datagram is None and self._parking.collect(now_nanos, waits=True):
            datagram = take_in_turn(self._turn, now_nanos, self._run_bytes)
        if datagram is None:
            self._parking.order()
        elif datagram.run is not None:
            self._parking.follow(self._turn[-1], now_nanos)
        self._is_sending = datagram is not None
        return datagram

    def _send(self, datagram: Datagram) -> int:
        """Send what was taken; return its bytes."""
        run = datagram.run
        count, size, sent, behind = 1, len(datagram.header) + datagram.part.nbytes, 0, 0
        has_failed = True
        try:
            if run is not None:
                count = run.parts_count
                sent = self._send_run(run, datagram.to)
                size = run.size if sent == count else sent * run.datagram_size
                if run.behind is not None:
                    behind = int(self._socket.send((run.behind,), datagram.to))
                    size += behind * len(run.behind)
            else:
                sent = int(self._socket.send((datagram.header, datagram.part), datagram.to))
            has_failed = False
        finally:
            with self._lock:
                self._is_sending = False
                self._count_sent(size, sent + behind, is_last=datagram.is_last and sent == count)
                if self._idle_waiters and self._is_idle():
                    self._idle.notify_all()
                if has_failed:
                    self._wake.notify_all()  # what was left to this thread is now ours
        return size

    def _express_run(
        self, outbox: Outbox, msg_type: int, topic: str, link: str, stamp_nanos: int, body: Buffer
    ) -> Optional[Datagram]:
        """Return the first parts of a large message if it may go by express."""
        if not self._is_idle():
            return None
        now_nanos = time.monotonic_ns()
        if outbox.pacer.wants_credit:
            self._parking.collect(now_nanos, waits=False)
        datagram = outbox.express_run(
            msg_type, topic, link, stamp_nanos, body, now_nanos, self._run_bytes
        )
        if datagram is not None:
            self._parking.follow(outbox, now_nanos)
        return datagram

    def _next_wake(self, now_nanos: int) -> float:
        """Return when something may go if nothing happens; infinity when nothing waits."""
        wakes = [outbox.next_wake(now_nanos) for outbox in self._turn]
        return min((wake for wake in wakes if wake is not None), default=math.inf)

    def _is_idle(self) -> bool:
        if self._is_closed:
            return True
        if self._is_sending:
            return False
        for outbox in self._turn:
            if not outbox.is_idle:
                return False
        return True

    def _wait_idle(self, is_idle: Callable[[], bool], timeout_s: float) -> bool:
        with self._lock:
            if is_idle():
                return True
            self._idle_waiters += 1
            try:
                return self._idle.wait_for(is_idle, timeout_s)
            finally:
                self._idle_waiters -= 1

    def _count_sent(self, size: int, datagrams: int, *, is_last: bool) -> None:
        if datagrams:
            self._sent["sent_datagrams"] += datagrams
            self._sent["sent_bytes"] += size
            self._sent["sent_messages"] += is_last


def take_in_turn(outboxes: List[Outbox], now_nanos: int, most_bytes: int = 0) -> Optional[Datagram]:
    """Return what `Outbox.take` returns, of any of them; whose turn it was goes to the end."""
    for index, outbox in enumerate(outboxes):
        datagram = outbox.take(now_nanos, most_bytes)
        if datagram is not None:
            outboxes.append(outboxes.pop(index))
            return datagram
    return None


def _ask_nobody(_: Address) -> None:
    """Send to an address without telling a guard."""
