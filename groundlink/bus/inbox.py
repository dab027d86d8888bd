# SPDX-License-Identifier: Apache-2.0
"""What has arrived and was not yet looked at: bounded, newest kept, losses counted.

Rule: `put` is called on the transport's thread and only stores bytes; decoding and its errors
happen on the thread of the one who reads.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from typing import Generic

from groundlink.messages.base import BadMessage, M, decode


class BusInbox(Generic[M]):
    """A queue of messages of one or more keys.

    Parameters
    ----------
    depth
        messages it holds; when one more comes, the oldest is dropped and counted.
    """

    def __init__(self, *, depth: int) -> None:
        self.dropped_of: Counter[str] = Counter()
        """Messages that were pushed out by newer ones, by key."""

        self.refused = 0
        """Messages that did not fit their schema."""

        self.last_refusal = ""
        self._waiting: deque[tuple[str, bytes, type[M]]] = deque()
        self._depth = depth
        self._arrived = threading.Condition()

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def dropped(self) -> int:
        """Messages that were pushed out by newer ones."""
        return self.dropped_of.total()

    def put(self, key: str, payload: bytes, message_type: type[M]) -> None:
        """Store a message's bytes."""
        with self._arrived:
            if len(self._waiting) >= self._depth:
                self.dropped_of[self._waiting.popleft()[0]] += 1
            self._waiting.append((key, payload, message_type))
            self._arrived.notify()

    def wait(self, seconds: float) -> None:
        """Wait until a message is here, or so long."""
        with self._arrived:
            if not self._waiting:
                self._arrived.wait(seconds)

    def get(self, *, seconds: float) -> tuple[str, M] | None:
        """Return the oldest waiting message with its key, or None when none comes in time.

        Messages that do not fit their schema are counted and passed over.
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
            except BadMessage as error:
                self.refused += 1
                self.last_refusal = f"{key}: {error}"
