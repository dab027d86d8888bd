# SPDX-License-Identifier: Apache-2.0
"""The ends of the soak: processes of their own, so that the memory of each can be told.

Rule: an end does what it is told through a pipe, and tells through it what its link hands over.
Nothing is judged here, and no garbage is collected but by the interpreter's own rules.
"""

from __future__ import annotations

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
DONE, TOOK, WRONG = "done", "took", "wrong"
_ANSWER_SECONDS = 60.0
_TAG = struct.Struct("<QQI")
LOCAL = ("127.0.0.1", 0)

Tell = Callable[..., None]


class Sender:
    """The sending end; `life` tells its links apart."""

    def __init__(self, tell: Tell) -> None:
        self._number = 0

    def open(self, bind: Address, to: Address, life: int) -> Address:
        """Make a link; return where it is bound."""
        self._life = life
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
        """Wait until nothing waits to be sent."""
        self._link.flush(5.0)

    def delivery_counts(self) -> list[DeliveryCounts]:
        """Return what became of what was sent."""
        return self._link.delivery_counts()

    def close(self) -> None:
        """End the link."""
        self._link.close()

    def _body(self, size: int) -> bytes:
        self._number += 1
        rest = self._number.to_bytes(8, "little") * (size // 8)
        return _TAG.pack(self._life, self._number, zlib.crc32(rest)) + rest


class Receiver:
    """The receiving end."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell

    def open(self, bind: Address) -> Address:
        """Make a link; return where it is bound."""
        self._link = Link(bind, on_message=self._take, report=True)
        return self._link.address

    def restart(self, *, is_crash: bool) -> None:
        """End the link, in a crash without a last word, and make another one in its place."""
        address = self._link.address
        if is_crash:
            self._link._receiving._report = False
        self._link.close()
        self.open(address)

    def nothing(self) -> None:
        """Answer; all that was told before is told by then."""

    def _take(self, message: Message, sender: object) -> None:
        if not MSG_TYPES[message.msg_type].ros_type:
            return
        body = memoryview(message.body)
        life, number, crc = _TAG.unpack_from(body)
        if zlib.crc32(body[_TAG.size :]) != crc:
            self._tell(WRONG, f"{message.topic} #{message.seq_number}: not what was sent")
        self._tell(TOOK, life, number, message.msg_type, message.topic)


class End:
    """An end's process, seen from the one that started it."""

    def __init__(self, kind: type[Sender] | type[Receiver], on_told: Tell) -> None:
        # A fresh interpreter: no threads, files or modules of this one.
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(kind, there), daemon=True)
        self._process.start()
        there.close()
        self._on_told = on_told
        self._answers: queue.Queue[Any] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def begin(self, what: str, *arguments: object, **named: object) -> None:
        """Tell the process to call a method."""
        self._pipe.send((what, arguments, named))

    def answer(self) -> Any:
        """Return what the method returned."""
        return self._answers.get(timeout=_ANSWER_SECONDS)

    def do(self, what: str, *arguments: object, **named: object) -> Any:
        """Call a method in the process."""
        self.begin(what, *arguments, **named)
        return self.answer()

    def kill(self) -> None:
        """End the process as a crash would; what it told before is heard."""
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
                self._answers.put(rest[0])
            else:
                self._on_told(what, *rest)


def _serve(kind: type[Sender] | type[Receiver], pipe: Connection) -> None:
    talking = threading.Lock()

    def tell(*what: object) -> None:
        with talking:
            pipe.send(what)

    end = kind(tell)
    while True:
        try:
            what, arguments, named = pipe.recv()
        except EOFError:
            return
        tell(DONE, getattr(end, what)(*arguments, **named))
