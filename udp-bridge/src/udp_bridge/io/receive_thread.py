# SPDX-License-Identifier: Apache-2.0
"""Receive loop: receives datagrams in the link's receiving thread and hands messages over.

Errors of the network were counted in `receiver`; `WorkerThread` counts exceptions of a turn. A
socket with `receive_batch` returns many predicted parts at once, any other socket single datagrams.
"""

from __future__ import annotations

import time
from typing import Any, Callable, Optional

from udp_bridge.receiver.delivery_reports import Answer
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.receiver.small_topics import SmallMessage, WholeMessage
from udp_bridge.wire.header import NANOS, Refused
from udp_bridge.wire.message import Address, Message
from udp_bridge.wire.types import MSG_TYPES

from .udp_socket import DatagramSocket
from .worker_thread import ErrorCounter

_REPORT_NANOS = NANOS
_LAST_REPORTS = 3
"""Copies of the last report, which is never repeated and may be lost."""
_SMALL_NANOS = 200_000
"""After this time a turn takes no more small messages."""
BLOCKED_NANOS = 5 * NANOS
"""A turn takes at most 0.1 s unless `on_message` does not return."""

OnMessage = Callable[[Message, Address], None]


class ReceiveLoop:
    """Receives datagrams from a socket until `end` is called.

    Parameters
    ----------
    answer
        Sends Credits, requests and reports.
    errors
        Counts exceptions of `on_message`.
    report, confirmed
        See `Link`.
    """

    def __init__(
        self,
        socket: DatagramSocket,
        inbox: Inbox,
        on_message: Optional[OnMessage],
        answer: Callable[[bytes, Address], None],
        errors: ErrorCounter,
        *,
        report: bool,
        confirmed: bool,
    ) -> None:
        self._socket = socket
        self._inbox = inbox
        self._on_message = on_message
        self._answer = answer
        self._errors = errors
        self._report = report
        self._confirmed = confirmed
        self._is_ended = False
        self._receive_batch: Any = getattr(socket, "receive_batch", None)
        self._buffer = bytearray(1 << 16)
        self._turn_nanos = time.monotonic_ns()
        self._report_nanos = self._turn_nanos + _REPORT_NANOS

    def end(self) -> None:
        """End after the current turn."""
        self._is_ended = True

    @property
    def is_blocked(self) -> bool:
        """Whether the current turn has taken so long that datagrams are lost."""
        is_late = time.monotonic_ns() - self._turn_nanos > BLOCKED_NANOS
        return is_late and not self._is_ended

    def turn(self) -> bool:
        """Process what was received, or is received within 0.1 s; return False after `end`."""
        self._turn_nanos = now_nanos = time.monotonic_ns()
        if self._report and now_nanos >= self._report_nanos:
            self._report_nanos = now_nanos + _REPORT_NANOS
            self._send_reports(now_nanos)
        try:
            if self._receive_batch is None:
                self._receive_one()
            else:
                self._receive_many()
        except Exception:
            self._inbox.reset_prediction()  # the predicted parts may have caused it
            raise
        self._inbox.update_logs_if_due(now_nanos)
        return not self._is_ended

    def finish(self) -> None:
        """Give up unfinished messages, send the last reports, and release the link."""
        self._inbox.reassembler.give_up_all()
        for _ in range(_LAST_REPORTS if self._report else 0):
            self._send_reports(time.monotonic_ns())
        self._answer, self._on_message = _ignore, None  # both refer to the link

    def _receive_many(self) -> None:
        slots, credits = self._inbox.predict_slots()
        batch = self._receive_batch(slots, credits)
        while type(batch) is SmallMessage:
            taken_nanos = self._inbox.count_delivered()
            self._deliver(*batch)
            if taken_nanos > self._turn_nanos + _SMALL_NANOS or self._is_ended:
                return
            batch = self._receive_batch(slots, credits)  # they change no prediction
        if type(batch) is WholeMessage:
            self._inbox.take_whole(batch)
            self._deliver(batch.message, slots.sender)
            self._inbox.follow_whole(slots, credits, batch)
            return
        now_nanos = time.monotonic_ns()
        if batch is None:
            self._inbox.reassembler.expire(now_nanos)
        elif not self._is_ended:  # a socket that was shut returns empty datagrams
            for taken in self._inbox.receive_batch(slots, batch, now_nanos):
                self._hand_over(*taken, now_nanos)
            self._send_requests(now_nanos)

    def _receive_one(self) -> None:
        try:
            received = self._socket.receive_into(self._buffer)
        except Refused as refused:
            self._inbox.refuse(refused.reason)
            received = None
        now_nanos = time.monotonic_ns()
        if received is None:
            self._inbox.reassembler.expire(now_nanos)
        elif not self._is_ended:
            size, sender = received
            datagram = memoryview(self._buffer)[:size]
            taken = self._inbox.receive(datagram, sender, now_nanos)
            self._hand_over(*taken, sender, now_nanos)

    def _send_reports(self, now_nanos: int) -> None:
        self._inbox.kernel_drops = self._socket.kernel_drops
        for answer, to in self._inbox.reports(now_nanos, time.time_ns()):
            self._answer(answer, to)

    def _hand_over(
        self,
        message: Optional[Message],
        credit: Optional[Answer],
        sender: Address,
        now_nanos: int,
    ) -> None:
        self._send_requests(now_nanos)  # first: a message waits for these
        if credit is not None:
            self._answer(*credit)
        if message is not None:
            self._deliver(message, sender)

    def _send_requests(self, now_nanos: int) -> None:
        if self._inbox.reassembler.pending_nacks:
            for request in self._inbox.requests(now_nanos):
                self._answer(*request)

    def _deliver(self, message: Message, sender: Address) -> None:
        if self._is_ended:
            return
        try:
            if self._on_message is not None:
                self._on_message(message, sender)
        except Exception:
            self._errors.caught(f"on_message of {message}")
            self._inbox.mark_dropped(message, sender)
            return
        if not self._confirmed or MSG_TYPES[message.msg_type].ros_type is None:
            self._inbox.mark_published(message, sender, time.time_ns())


def _ignore(_: bytes, __: Address) -> None:
    """Do nothing."""
