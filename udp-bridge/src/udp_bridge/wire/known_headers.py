# SPDX-License-Identifier: Apache-2.0
"""Headers of messages that left, for others that are like them but for number and stamp.

Bounded, by forgetting all. Who may use them, and when, is `sending`'s to say.
"""

from __future__ import annotations

from typing import Dict, NamedTuple, Optional, Tuple

from .fragments import Split
from .message import Message

EXPRESS_TOPICS = 1024
"""Topics, with their links, whose headers are kept."""

Topic = Tuple[int, str, str]
"""msg_type, topic and link."""


class Alike(NamedTuple):
    """A message of several parts; others of its topic are often as large."""

    packed: bytes
    """Header of part 0."""
    body_size: int
    cut: Split
    limit_nanos: Optional[int]
    """So long it may be sent again; None: never."""


class KnownHeaders:
    """Of one destination."""

    def __init__(self) -> None:
        self.small: Dict[Topic, Tuple[bytes, int]] = {}
        """Of single parts: the header, and the largest body that takes no second part."""
        self.large: Dict[Topic, Alike] = {}

    def remember(
        self,
        message: Message,
        packed: bytes,
        body_size: int,
        cut: Split,
        limit_nanos: Optional[int],
    ) -> None:
        """Keep the header of part 0 of a message."""
        key = (message.msg_type, message.topic, message.link)
        if len(self.small) + len(self.large) >= EXPRESS_TOPICS:
            self.small.clear()
            self.large.clear()
        if cut.parts_max == 1:
            self.small[key] = packed, cut.part_size
        else:
            self.large[key] = Alike(packed, body_size, cut, limit_nanos)

    def forget(self, msg_type: int, topic: str) -> None:
        """Keep no header of a topic any more."""
        for key in [key for key in (*self.small, *self.large) if key[:2] == (msg_type, topic)]:
            self.small.pop(key, None)
            self.large.pop(key, None)
