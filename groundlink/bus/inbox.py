# SPDX-License-Identifier: Apache-2.0
"""Inbox: a bounded queue between Zenoh's threads and the thread that reads.

`put` runs on a thread of Zenoh and only stores bytes. Decoding happens in the reading thread.
"""

import queue
import threading
import time
from collections import Counter
from typing import Generic

from groundlink.messages.base import BadBusMessage, M, decode

from .channel import Payload

WaitingMessage = tuple[str, Payload, type[M]]
"""Key, bytes and type."""


class BusInbox(Generic[M]):
    """A queue of messages of one or more keys, with one reading thread.

    Parameters
    ----------
    depth
        maximum number of messages. When the queue is full, the oldest is dropped and counted.
    """

    def __init__(self, *, depth: int) -> None:
        self.depth = depth
        self.dropped_of: Counter[str] = Counter()
        """Messages dropped because the queue was full, by key."""

        self.refused = 0
        """Messages that did not match their schema."""

        self.last_refusal = ""
        # A condition would wake the reader before it can have the interpreter's lock.
        self._waiting: queue.SimpleQueue[WaitingMessage[M]] = queue.SimpleQueue()
        self._first: WaitingMessage[M] | None = None
        """Oldest message, if the reader has waited for it and not yet taken it."""

        self._dropping = threading.Lock()

    def __len__(self) -> int:
        return self._waiting.qsize() + (self._first is not None)

    @property
    def dropped(self) -> int:
        """Messages dropped because the queue was full."""
        return self.dropped_of.total()

    def put(self, key: str, payload: Payload, message_type: type[M]) -> None:
        """Store a message's bytes."""
        if self._waiting.qsize() >= self.depth:
            self._drop_oldest()
        self._waiting.put((key, payload, message_type))

    def _drop_oldest(self) -> None:
        with self._dropping:  # several threads put
            while self._waiting.qsize() >= self.depth:
                try:
                    key, _, _ = self._waiting.get_nowait()
                except queue.Empty:  # the reader has taken all meanwhile
                    return
                self.dropped_of[key] += 1

    def wait(self, seconds: float) -> None:
        """Wait until a message is in the queue, for at most `seconds`."""
        if self._first is None:
            self._first = self._take(seconds)

    def _take(self, seconds: float) -> WaitingMessage[M] | None:
        try:
            return self._waiting.get(timeout=max(seconds, 0.0))
        except queue.Empty:
            return None

    def get(self, *, seconds: float) -> tuple[str, M] | None:
        """Return the oldest message with its key; None after a timeout of `seconds`.

        Messages that do not match their schema are counted and skipped.
        """
        deadline = time.monotonic() + seconds
        while True:
            first = self._first or self._take(deadline - time.monotonic())
            self._first = None
            if first is None:
                return None
            key, payload, message_type = first
            try:
                return key, decode(payload, message_type)
            except BadBusMessage as error:
                self.refused += 1
                self.last_refusal = f"{key}: {error}"
