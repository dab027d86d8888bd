# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus through pipes, for processes of a pipeline that need no router.

Each process reads a stream of messages, passes them on and adds the messages that it publishes. All
messages then have one order, which depends on the run alone. A process that is faster than the next
one waits for it, since a pipe is limited.
"""

import os
import signal
import struct
import sys
from collections.abc import Callable, Iterator
from typing import IO, NamedTuple

from groundlink.messages.base import BusMessage, encode

from .core_topics import Delivery
from .session import Bus

PIPE_BYTES = 1 << 20
"""Size of a pipe and of the buffers at its ends: the largest that Linux grants every user."""

_HEAD = struct.Struct("<HI")
"""Sizes of a message's key and payload, which follow."""


class PipedMessage(NamedTuple):
    """A message of the bus."""

    key: str
    payload: bytes


def read_piped(stream: IO[bytes]) -> Iterator[PipedMessage]:
    """Yield the messages of a stream until its end."""
    while len(head := stream.read(_HEAD.size)) == _HEAD.size:
        key_bytes, payload_bytes = _HEAD.unpack(head)
        key, payload = stream.read(key_bytes), stream.read(payload_bytes)
        if (len(key), len(payload)) != (key_bytes, payload_bytes):
            return  # The process before was killed.
        yield PipedMessage(key.decode(), payload)


def standard_streams() -> tuple[IO[bytes], IO[bytes]]:
    """Return standard input and output for messages; what a library prints goes to stderr.

    The process ends like any other of a pipeline once nobody reads its output.
    """
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb", PIPE_BYTES)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    return os.fdopen(sys.stdin.fileno(), "rb", PIPE_BYTES), out


class PipeBus(Bus):
    """Stands in for the session of a process in a pipeline: all that it publishes is written.

    There are no other sessions: nothing is ever present or lost, and queries have the answers
    that were stored.

    Attributes
    ----------
    answers
        by key and parameters: the answer to a query.
    """

    def __init__(self, out: IO[bytes]) -> None:
        self._out = out
        self.answers: dict[tuple[str, str], bytes] = {}

    def write(self, key: str, payload: bytes) -> None:
        """Write a message."""
        name = key.encode()
        self._out.write(_HEAD.pack(len(name), len(payload)) + name)
        self._out.write(payload)

    def close(self) -> None:
        """Write what is buffered."""
        self._out.flush()

    def is_connected(self) -> bool:
        """Return True."""
        return True

    def reconnects(self) -> int:
        """Return 0."""
        return 0

    def publisher(
        self, key: str, delivery: Delivery, *, bulky: bool = False, local: bool = False
    ) -> Callable[[BusMessage], bytes]:
        """Return a function that writes messages under `key` and returns their bytes."""

        def publish(message: BusMessage) -> bytes:
            payload = encode(message)
            self.write(key, payload)
            return payload

        return publish

    def hold(self) -> None:
        """Do nothing; the pipe is buffered."""

    def flush(self) -> None:
        """Do nothing: readers of the pipe wait for all of it."""

    def reading_publisher(
        self, key: str, delivery: Delivery, *, bulky: bool = False, local: bool = False
    ) -> Callable[[BusMessage], object]:
        """Return a function that writes messages under `key`."""
        return self.publisher(key, delivery)

    def serve_content(self, key: str, answer: Callable[[str, bytes], list[bytes]]) -> None:
        """Ignore the call; nobody asks."""

    def query(
        self, key: str, parameters: str = "", *, seconds: float, content: bytes | None = None
    ) -> dict[str, bytes]:
        """Return the stored answer, if any."""
        answer = self.answers.get((key, parameters))
        return {} if answer is None else {f"{key}/0": answer}

    def announce(self, key: str) -> Callable[[], None]:
        """Return a function that does nothing."""
        return lambda: None

    def present(self, key: str, *, seconds: float) -> set[str]:
        """Return no keys."""
        return set()

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        """Ignore the call; nothing changes."""
