# SPDX-License-Identifier: Apache-2.0
"""What arrived of one topic of one sender and what its user made of it, for the reports.

Time is an argument. An age is taken when a message reached its user, not when it was whole. Which
message is whole or lost is the reassembler's to say; here it is only counted, in `fates`.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, List, Optional, Tuple

from udp_bridge.wire.header import NANOS, Header
from udp_bridge.wire.message import Message
from udp_bridge.wire.reports import NO_AGE, TopicReport

from .delivery_log import Fates

AGES_KEPT = 1024
AGES_NANOS = 10 * NANOS
"""Ages are told of messages published within this time."""
WAITING_KEPT = 4096
"""Messages handed over whose user has not said what became of them; the oldest are dropped."""

Key = Tuple[int, int]
"""seq_number and stamp of a message."""


class TopicArrivals:
    """One topic in one life of its sender; another life is another instance.

    Handed over = published + dropped + waiting, at any time.
    """

    __slots__ = (
        "_ages_nanos",
        "_waiting",
        "body_bytes",
        "dropped",
        "fates",
        "first_seen_stamp_nanos",
        "first_stamp_nanos",
        "last_stamp_nanos",
        "published_count",
        "since_nanos",
    )

    def __init__(self) -> None:
        self.fates = Fates()
        self.published_count = 0
        self.dropped = 0
        self.body_bytes = 0
        self.first_seen_stamp_nanos = 0
        self.first_stamp_nanos = self.last_stamp_nanos = 0
        self.since_nanos: Optional[int] = None  # the first report gives it
        self._ages_nanos: Deque[Tuple[int, int]] = deque(maxlen=AGES_KEPT)  # published at, age
        self._waiting: OrderedDict[Key, int] = OrderedDict()

    def seen(self, header: Header) -> None:
        """Take note of a part that belongs to the topic and is no copy."""
        if not self.fates.numbers:
            self.first_seen_stamp_nanos = header.stamp_nanos
        self.fates.seen(header.seq_number)

    def handed(self, key: Key, size: int) -> None:
        """Take note of a message that was handed over: `published` or `drop` comes next."""
        if not self.fates.settle(key[0], "handed"):
            return
        self._waiting[key] = size
        if len(self._waiting) > WAITING_KEPT:
            self._waiting.popitem(last=False)
            self.dropped += 1

    def published(self, key: Key, wall_nanos: int) -> None:
        """Take note that a message reached its user when the wall clock said `wall_nanos`."""
        size = self._waiting.pop(key, None)
        if size is None:
            return  # of another life, or told before
        stamp_nanos = key[1]
        if not self.published_count:
            self.first_stamp_nanos = stamp_nanos
        self.published_count += 1
        self.body_bytes += size
        self.last_stamp_nanos = stamp_nanos
        self._ages_nanos.append((wall_nanos, wall_nanos - stamp_nanos))

    def drop(self, key: Key) -> None:
        """Take note that a message will not reach its user."""
        self.dropped += self._waiting.pop(key, None) is not None

    def report(self, msg_type: int, duplicates: int, wall_nanos: int) -> TopicReport:
        """Return what is so at this moment of the wall clock."""
        if self.since_nanos is None:
            self.since_nanos = wall_nanos
        while self._ages_nanos and wall_nanos - self._ages_nanos[0][0] > AGES_NANOS:
            self._ages_nanos.popleft()
        ages = sorted(age for _, age in self._ages_nanos)
        fates = self.fates
        return TopicReport(
            msg_type,
            fates.first_number,
            self.since_nanos,
            fates.numbers,
            self.published_count,
            self.dropped,
            fates.incomplete,
            fates.late,
            fates.open_count + len(self._waiting),
            fates.repaired,
            duplicates,
            self.body_bytes,
            self.first_seen_stamp_nanos,
            self.first_stamp_nanos,
            self.last_stamp_nanos,
            percentile(ages, 50),
            percentile(ages, 99),
        )


def key_of(message: Message) -> Key:
    """Return what tells a message from the others of its topic."""
    return message.seq_number, message.stamp_nanos


def percentile(ordered: List[int], percent: int) -> int:
    """Return the smallest of some ordered ages that `percent` of them do not exceed."""
    if not ordered:
        return NO_AGE
    return ordered[max(0, -(-len(ordered) * percent // 100) - 1)]
