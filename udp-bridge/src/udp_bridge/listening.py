# SPDX-License-Identifier: Apache-2.0
"""The receiving half of a link: the thread that takes what comes and hands messages over.

Nothing that the network does ends it: what is wrong was counted in `receiving`. Parts that are
expected come many at once where the socket can; what stands around one may lack that, and then
each datagram comes by itself.
"""

from __future__ import annotations

import logging
import time
from typing import Any, Callable, Optional

from .header import NANOS, Refused
from .leaving import Address
from .message import Message
from .receiving import Inbox
from .telling import Answer
from .types import MSG_TYPES
from .udp_socket import DatagramSocket

_REPORT_NANOS = NANOS
_LAST_REPORTS = 3
"""Nobody repeats the last word, and one copy in some may be lost."""
_log = logging.getLogger(__name__)

OnMessage = Callable[[Message, Address], None]


class Listening:
    """Takes datagrams from a socket, for as long as it is told.

    Parameters
    ----------
    answer
        Sends what is to be answered.
    report, confirmed
        As `Link` has them.
    """

    def __init__(
        self,
        socket: DatagramSocket,
        inbox: Inbox,
        on_message: Optional[OnMessage],
        answer: Callable[[bytes, Address], None],
        *,
        report: bool,
        confirmed: bool,
    ) -> None:
        self._socket = socket
        self._inbox = inbox
        self._on_message = on_message
        self._answer = answer
        self._report = report
        self._confirmed = confirmed
        self._is_ended = False

    def end(self) -> None:
        """Let `run` return as soon as the socket gives something, or is shut."""
        self._is_ended = True

    def run(self) -> None:
        """Take what comes until `end`."""
        receive_run: Any = getattr(self._socket, "receive_run", None)
        turn = self._turn if receive_run is None else self._turn_of_runs
        buffer = bytearray(1 << 16)
        due_nanos = time.monotonic_ns() + _REPORT_NANOS
        while not self._is_ended:
            now_nanos = turn(buffer, receive_run)
            self._inbox.take_note()  # behind the messages, which should not wait for it
            if self._report and now_nanos >= due_nanos:
                self._tell(now_nanos)
                due_nanos = now_nanos + _REPORT_NANOS

    def tell_last(self) -> None:
        """Give up what is open, tell all senders what became of what they sent, and let go."""
        self._inbox.reassembler.give_up_all()
        for _ in range(_LAST_REPORTS if self._report else 0):
            self._tell(time.monotonic_ns())
        self._answer, self._on_message = _to_nobody, None  # who answers refers to us again

    def _turn_of_runs(self, _: bytearray, receive_run: Any) -> int:
        place, credits = self._inbox.expected()
        run = receive_run(place, credits)
        now_nanos = time.monotonic_ns()
        if run is None:
            self._inbox.reassembler.expire(now_nanos)
        elif not self._is_ended:  # a socket that is shut gives empty datagrams
            for taken in self._inbox.receive_run(place, run, now_nanos):
                self._hand_over(*taken, now_nanos)
        return now_nanos

    def _turn(self, buffer: bytearray, _: Any) -> int:
        try:
            received = self._socket.receive_into(buffer)
        except Refused as refused:
            self._inbox.refuse(refused.reason)
            received = None
        now_nanos = time.monotonic_ns()
        if received is None:
            self._inbox.reassembler.expire(now_nanos)
        elif not self._is_ended:
            size, sender = received
            datagram = memoryview(buffer)[:size]
            taken = self._inbox.receive(datagram, sender, now_nanos, time.time_ns())
            self._hand_over(*taken, sender, now_nanos)
        return now_nanos

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
        if self._inbox.reassembler.to_ask:
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
            _log.exception("on_message failed for %s", message)
            self._inbox.dropped(message, sender)
            return
        if not self._confirmed or MSG_TYPES[message.msg_type].ros_type is None:
            self._inbox.published(message, sender, time.time_ns())


def _to_nobody(_: bytes, __: Address) -> None:
    """Answer nobody."""
