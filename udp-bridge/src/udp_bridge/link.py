# SPDX-License-Identifier: Apache-2.0
"""Messages in, messages out, over a socket of its own: the library's only threads and clocks.

One thread receives, one sends; `send` only queues. Nothing that the network does raises: it is
counted. What is decided is decided in `sending` and `receiving`, which know no time of day.
"""

from __future__ import annotations

import logging
import threading
import time
from types import TracebackType
from typing import Any, Callable, Dict, List, Optional, Type

from .counters import Counters
from .flow import DatagramKey
from .fragments import DatagramSize, TooLarge, check_datagram_size
from .header import NANOS, BadMessage, Buffer
from .holdings import Limits
from .message import Message
from .receiving import Inbox
from .sending import Address, Outbox, take_in_turn
from .udp_socket import UdpSocket, resolve

DEFAULT_RECEIVE_BUFFER = 8 << 20
"""The most that an unprivileged Linux process commonly gets, as the kernel accounts it."""
_WAIT_S = 0.1
"""How long the receiving thread sleeps at most; messages expire at this grain."""
_REPORT_NANOS = NANOS
_log = logging.getLogger(__name__)

OnMessage = Callable[[Message, Address], None]


class Link:
    """One end of a bridge: a bound socket with a sending and a receiving thread.

    Parameters
    ----------
    bind
        Host and port to receive at; port 0 takes a free one, see `address`.
    peer
        Where `send` sends to when it is not told otherwise.
    on_message
        Called in the receiving thread with each message and its sender, from the first one on,
        which may be before the constructor returns. While it runs, nothing is received. An
        exception in it is logged and ends nothing.
    receive_buffer
        Bytes to ask the kernel for, as the kernel accounts them; see the attribute.
    datagram
        `mtu`, `loopback` or the bytes of the largest datagram.
    signed_peer
        Keep to what a peer understands that reads the header's counts as signed.
    report
        Tell every sender once a second what arrived.
    limits
        What reassembly spends at most.

    Raises
    ------
    OSError
        When an address can't be resolved or bound.
    BadMessage
        When `datagram` is no datagram size.
    """

    def __init__(
        self,
        bind: Address,
        peer: Optional[Address] = None,
        *,
        on_message: Optional[OnMessage] = None,
        receive_buffer: int = DEFAULT_RECEIVE_BUFFER,
        datagram: DatagramSize = "loopback",
        signed_peer: bool = False,
        report: bool = False,
        limits: Optional[Limits] = None,
    ) -> None:
        self._datagram = check_datagram_size(datagram)
        self._signed_peer = signed_peer
        self._peer = peer
        self._on_message = on_message
        self._report = report
        self._wake = threading.Condition()  # guards all of the sending side
        self._routes: Dict[Address, Outbox] = {}  # by address as it was given
        self._outboxes: Dict[Address, Outbox] = {}  # by numeric address
        self._turn: List[Outbox] = []
        self._is_sending = False
        self._is_closed = False
        self._sent = {"sent_messages": 0, "sent_datagrams": 0, "sent_bytes": 0}
        self._too_large = 0
        if peer is not None:
            self._outbox(peer)
        self._socket = UdpSocket(bind, receive_buffer=receive_buffer, wait_s=_WAIT_S)
        self._inbox = Inbox(
            receive_buffer=self.receive_buffer, on_credit=self._credited, limits=limits
        )
        self._threads = [
            threading.Thread(target=target, name=f"udp_bridge {name}", daemon=True)
            for target, name in ((self._receive_loop, "receive"), (self._send_loop, "send"))
        ]
        for thread in self._threads:
            thread.start()

    @property
    def address(self) -> Address:
        """Host and port that the socket is bound to."""
        return self._socket.address

    @property
    def receive_buffer(self) -> int:
        """Bytes of the receive buffer that the kernel granted, as it accounts them."""
        return self._socket.receive_buffer

    @property
    def received(self) -> Counters:
        """What became of the datagrams that came."""
        return self._inbox.reassembler.counters

    def send(
        self,
        msg_type: int,
        topic: str,
        link: str,
        stamp_nanos: int,
        body: Buffer,
        to: Optional[Address] = None,
    ) -> None:
        """Queue a message; never blocks, from any thread. After `close` it does nothing.

        Parameters
        ----------
        msg_type, topic, link
            As in the header.
        stamp_nanos
            Nanoseconds since the POSIX epoch.
        body
            Any contiguous bytes-like object. It is not copied: leave it unchanged.
        to
            Where to; the link's peer when not given.

        Raises
        ------
        BadMessage
            When a field is out of range, or there is nowhere to send to.
        TooLarge
            When the message fits at no datagram size; also counted.
        """
        to = to if to is not None else self._peer
        if to is None:
            raise BadMessage("nowhere to send to: the link has no peer and no `to` was given")
        message = Message(msg_type, topic, link, stamp_nanos, 0, body)
        with self._wake:
            if self._is_closed:
                return
            try:
                self._outbox(to).put(message)
            except TooLarge:
                self._too_large += 1
                raise
            self._wake.notify_all()

    def flush(self, timeout_s: float) -> bool:
        """Wait until all that was queued is sent; return whether it is."""
        with self._wake:
            return self._wake.wait_for(self._is_idle, timeout_s)

    def counters(self) -> Dict[str, Any]:
        """Return what was sent, received and lost, by name; `refused` is a dict by reason."""
        with self._wake:
            outboxes = list(self._outboxes.values())
            counts: Dict[str, Any] = {
                **self._sent,
                "superseded": sum(outbox.superseded for outbox in outboxes),
                "too_large": self._too_large,
                "unreachable": self._socket.unreachable,
                "stalls": sum(outbox.pacer.stalls for outbox in outboxes),
            }
        counts["received_datagrams"] = self._inbox.datagrams
        counts["received_bytes"] = self._inbox.bytes_received
        counts["kernel_drops"] = self._socket.kernel_drops
        counts.update(self.received.as_dict())
        return counts

    def close(self) -> None:
        """End both threads at once; what waits is dropped, what is open counts as incomplete."""
        with self._wake:
            if self._is_closed:
                return
            self._is_closed = True
            self._wake.notify_all()
        self._socket.shut()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join()
        self._socket.close()
        self._inbox.reassembler.give_up_all()

    def __enter__(self) -> Link:
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        traceback: Optional[TracebackType],
    ) -> None:
        self.close()

    def _outbox(self, to: Address) -> Outbox:
        outbox = self._routes.get(to)
        if outbox is None:
            numeric = resolve(to)
            outbox = self._outboxes.get(numeric)
            if outbox is None:
                outbox = Outbox(numeric, self._datagram, signed_peer=self._signed_peer)
                self._outboxes[numeric] = outbox
                self._turn.append(outbox)
            self._routes[to] = outbox
        return outbox

    def _credited(self, sender: Address, key: DatagramKey, receive_buffer: int) -> None:
        with self._wake:
            outbox = self._outboxes.get(sender)
            if outbox is not None:
                outbox.pacer.acknowledged(key, receive_buffer, time.monotonic_ns())
                self._wake.notify_all()

    def _receive_loop(self) -> None:
        buffer = bytearray(1 << 16)
        view = memoryview(buffer)
        due_nanos = time.monotonic_ns() + _REPORT_NANOS
        while not self._is_closed:
            received = self._socket.receive_into(buffer)
            now_nanos = time.monotonic_ns()
            if received is None:
                self._inbox.reassembler.expire(now_nanos)
            elif not self._is_closed:
                self._receive(view[: received[0]], received[1], now_nanos)
            if self._report and now_nanos >= due_nanos:
                due_nanos = now_nanos + _REPORT_NANOS
                self._inbox.kernel_drops = self._socket.kernel_drops
                for answer, to in self._inbox.reports(now_nanos, time.time_ns()):
                    self._answer(answer, to)

    def _receive(self, datagram: memoryview, sender: Address, now_nanos: int) -> None:
        message, credit = self._inbox.receive(datagram, sender, now_nanos, time.time_ns())
        if credit is not None:
            self._answer(*credit)
        if message is not None and self._on_message is not None:
            try:
                self._on_message(message, sender)
            except Exception:
                _log.exception("on_message failed for %s", message)

    def _answer(self, answer: bytes, to: Address) -> None:
        is_sent = self._socket.send([answer], to)
        with self._wake:
            self._count_sent(len(answer), is_sent=is_sent, is_last=True)

    def _send_loop(self) -> None:
        while True:
            with self._wake:
                datagram = take_in_turn(self._turn, time.monotonic_ns())
                while datagram is None and not self._is_closed:
                    self._wake.wait(self._wait_s())
                    datagram = take_in_turn(self._turn, time.monotonic_ns())
                if datagram is None or self._is_closed:
                    return
                self._is_sending = True
            is_sent = self._socket.send([datagram.header, datagram.part], datagram.to)
            with self._wake:
                self._is_sending = False
                size = len(datagram.header) + datagram.part.nbytes
                self._count_sent(size, is_sent=is_sent, is_last=datagram.is_last)
                if self._is_idle():
                    self._wake.notify_all()

    def _wait_s(self) -> Optional[float]:
        now_nanos = time.monotonic_ns()
        wakes = [outbox.next_wake(now_nanos) for outbox in self._turn]
        waiting = [wake for wake in wakes if wake is not None]
        return max(0, min(waiting) - now_nanos) / NANOS if waiting else None

    def _is_idle(self) -> bool:
        return self._is_closed or (not self._is_sending and self._wait_s() is None)

    def _count_sent(self, size: int, *, is_sent: bool, is_last: bool) -> None:
        if is_sent:
            self._sent["sent_datagrams"] += 1
            self._sent["sent_bytes"] += size
            self._sent["sent_messages"] += is_last
