# SPDX-License-Identifier: Apache-2.0
"""The numbers that a sender gives its messages, for each type and topic; of one destination."""

from __future__ import annotations

from collections import OrderedDict

from .header import SEQ_NUMBERS, SIGNED_SEQ_NUMBERS
from .message import TopicKey

NUMBERED_TOPICS = 4096
"""Topics whose numbers are remembered; one that is forgotten begins at 0 like a restart."""


class Numbering:
    """Gives each message the next seq_number of its type and topic."""

    def __init__(self, *, signed_peer: bool = False) -> None:
        self._modulus = SIGNED_SEQ_NUMBERS if signed_peer else SEQ_NUMBERS
        self._next: OrderedDict[TopicKey, int] = OrderedDict()

    def next(self, msg_type: int, topic: str, count: int = 1) -> int:
        """Return the number of the next message, counted from 0, and give away `count`."""
        key = (msg_type, topic)
        number = self._next.pop(key, 0)
        self._next[key] = (number + count) % self._modulus
        if len(self._next) > NUMBERED_TOPICS:
            self._next.popitem(last=False)
        return number
