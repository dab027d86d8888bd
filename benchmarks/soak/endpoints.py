# SPDX-License-Identifier: Apache-2.0
"""Endpoints of the soak test: separate processes, so that the memory of each can be measured.

An endpoint executes calls that it receives through a pipe and reports received messages through it.
It never checks results or runs the garbage collector itself.
"""

import multiprocessing
import os
import queue
import struct
import threading
import time
import zlib
from collections import Counter
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from udp_bridge import Link, Message
from udp_bridge.sender.delivery_counts import DeliveryCounts
from udp_bridge.sender.repair import Resend
from udp_bridge.wire.message import Address
from udp_bridge.wire.types import MSG_TYPES

DATAGRAM = 8192
TOPICS = (
    (2, "/imu", 0.005, 320),
    (5, "/wheels", 0.02, 200),
    (1, "/points", 0.1, 200_000),
    (33, "/image", 0.1, 100_000),
)
"""Type, topic, period in s, bytes of a body."""
REPAIR = {(33, "/image"): Resend(500_000_000)}
DONE, RECEIVED, CORRUPT = "done", "received", "corrupt"
_RESULT_SECONDS = 60.0
_TAG = struct.Struct("<QQI")
LOCAL = ("127.0.0.1", 0)

Report = Callable[..., None]


class SendingEndpoint:
    """Sends messages; `incarnation` identifies the link that sent one."""

    def __init__(self, report: Report) -> None:
        self._number = 0

    def open(self, bind: Address, to: Address, incarnation: int) -> Address:
        """Open a link; return its address."""
        self._incarnation = incarnation
        self._link = Link(bind, to, datagram=DATAGRAM, repair=REPAIR)
        return self._link.address

    def send_for(self, seconds: float) -> Counter[tuple[int, str]]:
        """Send every topic at its rate; return how many of each."""
        begun = time.monotonic()
        due = {topic: begun for _, topic, _, _ in TOPICS}
        sent: Counter[tuple[int, str]] = Counter()
        while (now := time.monotonic()) < begun + seconds:
            for msg_type, topic, period, size in TOPICS:
                if now >= due[topic]:
                    due[topic] += period
                    self._link.send(msg_type, topic, "", time.time_ns(), self._body(size))
                    sent[msg_type, topic] += 1
            time.sleep(max(0.0, min(due.values()) - time.monotonic()))
        return sent

    def flush(self) -> None:
        """Wait until the send queue is empty."""
        self._link.flush(5.0)

    def delivery_counts(self) -> list[DeliveryCounts]:
        """Return the outcome of the sent messages."""
        return self._link.delivery_counts()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _body(self, size: int) -> bytes:
        self._number += 1
        rest = self._number.to_bytes(8, "little") * (size // 8)
        return _TAG.pack(self._incarnation, self._number, zlib.crc32(rest)) + rest


class ReceivingEndpoint:
    """Receives messages and reports each one."""

    def __init__(self, report: Report) -> None:
        self._report = report

    def open(self, bind: Address) -> Address:
        """Open a link; return its address."""
        self._link = Link(bind, on_message=self._take, report=True)
        return self._link.address

    def restart(self, *, is_crash: bool) -> None:
        """Replace the link by a new one; after a crash it sends no last reports."""
        address = self._link.address
        if is_crash:
            self._link._receiving._report = False
        self._link.close()
        self.open(address)

    def ping(self) -> None:
        """Return; earlier reports have arrived by then."""

    def _take(self, message: Message, sender: object) -> None:
        if not MSG_TYPES[message.msg_type].ros_type:
            return
        body = memoryview(message.body)
        incarnation, number, crc = _TAG.unpack_from(body)
        if zlib.crc32(body[_TAG.size :]) != crc:
            self._report(CORRUPT, f"{message.topic} #{message.seq_number}: not what was sent")
        self._report(RECEIVED, incarnation, number, message.msg_type, message.topic)


class EndpointProcess:
    """Handle of an endpoint's process."""

    def __init__(
        self, kind: type[SendingEndpoint] | type[ReceivingEndpoint], on_report: Report
    ) -> None:
        # A fresh interpreter: no threads, files or modules of this one.
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(kind, there), daemon=True)
        self._process.start()
        there.close()
        self._on_report = on_report
        self._results: queue.Queue[Any] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def call_async(self, what: str, *arguments: object, **named: object) -> None:
        """Report the process to call a method."""
        self._pipe.send((what, arguments, named))

    def result(self) -> Any:
        """Return the result of that call."""
        return self._results.get(timeout=_RESULT_SECONDS)

    def call(self, what: str, *arguments: object, **named: object) -> Any:
        """Call a method in the process."""
        self.call_async(what, *arguments, **named)
        return self.result()

    def kill(self) -> None:
        """Kill the process; its earlier reports are received."""
        self._process.kill()
        self._process.join()
        self._reader.join()
        self._pipe.close()

    def resident_kb(self) -> float:
        """Return the memory of the process that is resident."""
        with open(f"/proc/{self._process.pid}/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1024

    def _read(self) -> None:
        while True:
            try:
                what, *rest = self._pipe.recv()
            except (EOFError, OSError):
                return
            if what == DONE:
                self._results.put(rest[0])
            else:
                self._on_report(what, *rest)


def _serve(kind: type[SendingEndpoint] | type[ReceivingEndpoint], pipe: Connection) -> None:
    talking = threading.Lock()

    def report(*what: object) -> None:
        with talking:
            pipe.send(what)

    end = kind(report)
    while True:
        try:
            what, arguments, named = pipe.recv()
        except EOFError:
            return
        report(DONE, getattr(end, what)(*arguments, **named))
