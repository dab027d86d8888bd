# SPDX-License-Identifier: Apache-2.0
"""Local inbox: an inbox whose reading thread reads local streams itself.

A thread for each stream would cost a context switch for each message, and time until it runs.
"""

import os
import queue
import select
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from groundlink.messages.base import M

from .channel import Payload
from .inbox import BusInbox, WaitingMessage
from .local_stream import LocalSource


class StoredPayloads:
    """Payloads that come by the router, for a reader that waits elsewhere (a `PayloadSource`).

    Parameters
    ----------
    subscribe
        calls a function with each payload, on a thread of Zenoh; returns the subscription.
    wake
        called after each payload.
    """

    def __init__(
        self,
        subscribe: Callable[[Callable[[bytes], None]], Any],
        wake: Callable[[], None],
        *,
        depth: int,
    ) -> None:
        self._waiting: deque[bytes] = deque(maxlen=depth)

        def store(payload: bytes) -> None:
            self._waiting.append(payload)
            wake()

        self._subscription = subscribe(store)

    def receive(self) -> bytes:
        """Return the next payload; an empty one if there is none."""
        return self.poll() or b""

    def poll(self) -> bytes | None:
        """Return the next payload; None if there is none."""
        return self._waiting.popleft() if self._waiting else None

    def undeclare(self) -> None:
        """Receive no more."""
        self._subscription.undeclare()


class _Stream(NamedTuple):
    key: str
    message_type: type[M]  # type: ignore[valid-type]
    source: LocalSource


class LocalInbox(BusInbox[M]):
    """Messages of Zenoh's threads, and of the sockets of local streams."""

    def __init__(self, *, depth: int) -> None:
        super().__init__(depth=depth)
        self._poll = select.epoll()
        self._wake = os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK)
        self._poll.register(self._wake, select.EPOLLIN)
        self._is_asleep = False
        self._routed: dict[LocalSource, _Stream] = {}
        """Streams whose messages come by the router."""

        self._local: dict[int, _Stream] = {}
        """Streams whose messages come by a socket, by its number."""

    def add(self, key: str, message_type: type[M], source: LocalSource) -> None:
        """Read a stream, too; called in the reading thread."""
        self._routed[source] = _Stream(key, message_type, source)

    def put(self, key: str, payload: Payload, message_type: type[M]) -> None:
        """Store a message's bytes."""
        super().put(key, payload, message_type)
        if self._is_asleep:
            self.wake()

    def wake(self) -> None:
        """Let the reading thread look for messages of streams that come by the router."""
        os.eventfd_write(self._wake, 1)

    def __len__(self) -> int:
        """Return how many messages wait; of those that have not been read yet, at least one."""
        return super().__len__() + len(self._poll.poll(0.0))

    def undeclare(self) -> None:
        """Read no more."""
        self._poll.close()
        os.close(self._wake)

    def _take(self, seconds: float) -> WaitingMessage[M] | None:
        deadline = time.monotonic() + seconds
        while True:
            try:
                return self._waiting.get_nowait()
            except queue.Empty:
                pass
            self._is_asleep = True  # before the last look, so that nothing is put unnoticed
            wait = 0.0 if self._waiting.qsize() else deadline - time.monotonic()
            ready = self._poll.poll(max(wait, 0.0))
            self._is_asleep = False
            for number, _ in ready:
                if number == self._wake:
                    os.eventfd_read(self._wake)
                    for stream in [*self._routed.values()]:
                        self._read(stream)
                else:
                    self._read(self._local[number])
            if not ready and wait <= 0.0 and not self._waiting.qsize():
                return None

    def _read(self, stream: _Stream) -> None:
        """Store what has come of a stream; it may come by another way afterwards."""
        source, before = stream.source, stream.source.connection
        number = None if before is None else before.fileno()
        while (payload := source.poll()) is not None:
            super().put(stream.key, payload, stream.message_type)
        if (now := source.connection) is not before:
            if number is None:
                del self._routed[source]
            else:  # the closed socket has left the poll by itself
                del self._local[number]
            if now is None:
                self._routed[source] = stream
            else:
                self._local[now.fileno()] = stream
                self._poll.register(now, select.EPOLLIN)
