# SPDX-License-Identifier: Apache-2.0
"""Inbox: a bounded queue between Zenoh's threads and the thread that reads.

`put` runs on a thread of Zenoh and only stores bytes. Decoding happens in the reading thread.
"""

import threading
import time
from collections import Counter, deque
from typing import Generic

from groundlink.messages.base import BadBusMessage, M, decode


class BusInbox(Generic[M]):
    """A queue of messages of one or more keys.

    Parameters
    ----------
    depth
        maximum number of messages. When the queue is full, the oldest is dropped and counted.
    """

    def __init__(self, *, depth: int) -> None:
        self.dropped_of: Counter[str] = Counter()
        """Messages dropped because the queue was full, by key."""

        self.refused = 0
        """Messages that did not match their schema."""

        self.last_refusal = ""
        self._waiting: deque[tuple[str, bytes, type[M]]] = deque()
        self.depth = depth
        self._arrived = threading.Condition()

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def dropped(self) -> int:
        """Messages dropped because the queue was full."""
        return self.dropped_of.total()

    def put(self, key: str, payload: bytes, message_type: type[M]) -> None:
        """Store a message's bytes."""
        with self._arrived:
            if len(self._waiting) >= self.depth:
                self.dropped_of[self._waiting.popleft()[0]] += 1
            self._waiting.append((key, payload, message_type))
            self._arrived.notify()

    def wait(self, seconds: float) -> None:
        """Wait until a message is in the queue, for at most `seconds`."""
        with self._arrived:
            if not self._waiting:
                self._arrived.wait(seconds)

    def get(self, *, seconds: float) -> tuple[str, M] | None:
        """Return the oldest message with its key; None after a timeout of `seconds`.

        Messages that do not match their schema are counted and skipped.
        """
        deadline = time.monotonic() + seconds
        while True:
            with self._arrived:
                while not self._waiting:
                    remaining = deadline - time.monotonic()
                    if remaining <= 0 or not self._arrived.wait(remaining):
                        return None
                key, payload, message_type = self._waiting.popleft()
            try:
                return key, decode(payload, message_type)
            except BadBusMessage as error:
                self.refused += 1
                self.last_refusal = f"{key}: {error}"
