# SPDX-License-Identifier: Apache-2.0
"""The receiving half of a link: the thread that takes what comes and hands messages over.

Nothing that the network does ends it: what is wrong was counted in `receiving`, and `WorkerThread`
counts what a turn raises. Parts that are expected come many at once where the socket can; what
stands around one may lack that, and then each datagram comes by itself.
"""

from __future__ import annotations

import time
from typing import Any, Callable, Optional

from udp_bridge.receiver.delivery_reports import Answer
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.wire.header import NANOS, Refused
from udp_bridge.wire.message import Address, Message
from udp_bridge.wire.types import MSG_TYPES

from .udp_socket import DatagramSocket
from .worker_thread import ErrorCounter

_REPORT_NANOS = NANOS
_LAST_REPORTS = 3
"""Nobody repeats the last word, and one copy in some may be lost."""
DEAF_NANOS = 5 * NANOS
"""A turn takes 0.1 s at most, unless `on_message` does not return."""

OnMessage = Callable[[Message, Address], None]


class Listening:
    """Takes datagrams from a socket, for as long as it is told.

    Parameters
    ----------
    answer
        Sends what is to be answered.
    errors
        Counts what `on_message` raises.
    report, confirmed
        As `Link` has them.
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
        self._receive_run: Any = getattr(socket, "receive_run", None)
        self._buffer = bytearray(1 << 16)
        self._turned_nanos = time.monotonic_ns()
        self._report_nanos = self._turned_nanos + _REPORT_NANOS

    def end(self) -> None:
        """Make the turn that is under way the last, as soon as the socket gives something."""
        self._is_ended = True

    @property
    def is_deaf(self) -> bool:
        """Whether no turn has begun for so long that nothing is received any more."""
        is_late = time.monotonic_ns() - self._turned_nanos > DEAF_NANOS
        return is_late and not self._is_ended

    def turn(self) -> bool:
        """Take what has come, or what comes within 0.1 s; return False after `end`."""
        self._turned_nanos = now_nanos = time.monotonic_ns()
        if self._report and now_nanos >= self._report_nanos:
            self._report_nanos = now_nanos + _REPORT_NANOS
            self._tell(now_nanos)
        try:
            if self._receive_run is None:
                self._receive_one()
            else:
                self._receive_many()
        except Exception:
            self._inbox.reset_prediction()  # what was expected may be what failed
            raise
        self._inbox.update_logs()  # behind the messages, which should not wait for it
        return not self._is_ended

    def tell_last(self) -> None:
        """Give up what is open, tell all senders what became of what they sent, and let go."""
        self._inbox.reassembler.give_up_all()
        for _ in range(_LAST_REPORTS if self._report else 0):
            self._tell(time.monotonic_ns())
        self._answer, self._on_message = _to_nobody, None  # who answers refers to us again

    def _receive_many(self) -> None:
        place, credits = self._inbox.predict_slots()
        run = self._receive_run(place, credits)
        now_nanos = time.monotonic_ns()
        if run is None:
            self._inbox.reassembler.expire(now_nanos)
        elif not self._is_ended:  # a socket that is shut gives empty datagrams
            for taken in self._inbox.receive_batch(place, run, now_nanos):
                self._hand_over(*taken, now_nanos)

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

    def _tell(self, now_nanos: int) -> None:
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
        if self._inbox.reassembler.pending_nacks:
            for request in self._inbox.requests(now_nanos):  # a message waits for what they ask for
                self._answer(*request)
        if credit is not None:
            self._answer(*credit)
        if message is None or self._is_ended:
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


def _to_nobody(_: bytes, __: Address) -> None:
    """Answer nobody."""
