# SPDX-License-Identifier: Apache-2.0
"""Delivery log: what arrived of each topic, and what became of it. Source of the TopicReports.

`Counters` are the totals of a receiver. A `DeliveryLog` belongs to one topic of one sender, from
one restart of the sender to the next; its `MessageOutcomes` give each message exactly one outcome.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Any, Deque, Dict, List, Optional, Tuple

from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, Header
from udp_bridge.wire.reports import NO_AGE, TopicReport

from .ordering import MessageKey

REMEMBERED = 1024
"""Numbers behind the highest one that can still get an outcome."""
_MASK = (1 << REMEMBERED) - 1
AGES_KEPT = 1024
AGES_NANOS = 10 * NANOS
"""Ages are reported of messages published within this time."""
WAITING_KEPT = 4096
"""Delivered messages that were neither published nor dropped yet; the oldest count as dropped."""


class Counters:
    """Totals of a receiver. `refused` and `duplicates` count datagrams, the others messages."""

    __slots__ = ("duplicates", "incomplete", "late", "messages", "missing", "refused", "repaired")

    def __init__(self) -> None:
        self.messages = 0
        """Delivered messages."""
        self.incomplete = 0
        """Messages given up before all their parts arrived."""
        self.duplicates = 0
        """Repeated parts, or repeated messages of one part."""
        self.late = 0
        """Complete messages that were not delivered because a newer one was before them."""
        self.missing = 0
        """Gaps in seq_number, including those of incomplete and late messages."""
        self.repaired = 0
        """Delivered messages that had lost parts."""
        self.refused: Dict[str, int] = {}
        """Forbidden datagrams by reason."""

    def refuse(self, reason: str) -> None:
        """Count one refused datagram."""
        self.refused[reason] = self.refused.get(reason, 0) + 1

    def as_dict(self) -> Dict[str, Any]:
        """Return the counts by name, with a copy of `refused`."""
        names = ("messages", "incomplete", "duplicates", "late", "missing")
        counts: Dict[str, Any] = {name: getattr(self, name) for name in names}
        return {**counts, "refused": dict(self.refused)}


class MessageOutcomes:
    """Outcomes of a topic's messages by seq_number, from the first number seen.

    Invariant: `numbers` = delivered + incomplete + late + `open_count` + missing. The last
    `REMEMBERED` numbers are tracked one by one; older ones keep the outcome that they have, and
    without one they stay missing.
    """

    __slots__ = (
        "_arrived",
        "_highest",
        "_repaired",
        "_settled",
        "delivered",
        "first_number",
        "incomplete",
        "late",
        "numbers",
        "repaired",
    )

    def __init__(self) -> None:
        self.first_number = 0
        """The lowest number seen and remembered; lower ones are not counted."""
        self.numbers = 0
        """Count from the first to the highest number seen, both included."""
        self.delivered = 0
        self.incomplete = 0
        self.late = 0
        self.repaired = 0
        """Delivered messages that would be incomplete without repair."""
        self._highest = 0
        self._arrived = self._settled = self._repaired = 0  # bit 0 is the highest number's

    @property
    def open_count(self) -> int:
        """Messages of which a part arrived and that have no outcome yet."""
        return bin(self._arrived & ~self._settled).count("1")

    def mark_arrived(self, seq_number: int) -> None:
        """Record that a part of a message arrived."""
        if not self.numbers:
            self.first_number = self._highest = seq_number
            self.numbers = self._arrived = 1
            return
        if seq_number == self._highest:
            return
        ahead = (seq_number - self._highest) % SEQ_NUMBERS
        if ahead >= SEQ_NUMBERS // 2:
            behind = SEQ_NUMBERS - ahead
            if self.numbers <= behind < REMEMBERED:  # reordered, or resent
                self.first_number, self.numbers = seq_number, behind + 1
            self._arrived |= self._bit(seq_number)
            return
        # A forged number may be far ahead: don't shift farther than what is remembered.
        shift = min(ahead, REMEMBERED)
        self._arrived = (self._arrived << shift | 1) & _MASK
        self._settled = self._settled << shift & _MASK
        self._repaired = self._repaired << shift & _MASK
        self._highest = seq_number
        self.numbers += ahead

    def mark_repaired(self, seq_number: int) -> None:
        """Record that a part of an open message arrived by repair."""
        self.mark_arrived(seq_number)
        self._repaired |= self._bit(seq_number)

    def settle(self, seq_number: int, outcome: str) -> bool:
        """Give a message its outcome: `delivered`, `incomplete` or `late`.

        Returns False for a message that has one already or is too old.
        """
        if seq_number != self._highest or not self.numbers:
            self.mark_arrived(seq_number)
        bit = 1 if seq_number == self._highest else self._bit(seq_number)
        if not bit & ~self._settled:
            return False
        self._settled |= bit
        setattr(self, outcome, getattr(self, outcome) + 1)
        if outcome == "delivered" and self._repaired & bit:
            self.repaired += 1
        return True

    def _bit(self, seq_number: int) -> int:
        """Return the bit of a number, or 0 if it is too old."""
        behind = (self._highest - seq_number) % SEQ_NUMBERS
        return 1 << behind if behind < min(self.numbers, REMEMBERED) else 0


class DeliveryLog:
    """What arrived of one topic of one sender, and what its user did with it.

    Invariant: delivered = published + dropped + waiting. The age of a message is taken when it is
    published, not when it is complete.
    """

    __slots__ = (
        "_ages_nanos",
        "_waiting",
        "body_bytes",
        "dropped",
        "first_seen_stamp_nanos",
        "first_stamp_nanos",
        "last_stamp_nanos",
        "outcomes",
        "published",
        "since_nanos",
    )

    def __init__(self) -> None:
        self.outcomes = MessageOutcomes()
        self.published = 0
        self.dropped = 0
        self.body_bytes = 0
        self.first_seen_stamp_nanos = 0
        self.first_stamp_nanos = self.last_stamp_nanos = 0
        self.since_nanos: Optional[int] = None  # set by the first report
        self._ages_nanos: Deque[Tuple[int, int]] = deque(maxlen=AGES_KEPT)  # published at, age
        self._waiting: OrderedDict[MessageKey, int] = OrderedDict()

    def mark_arrived(self, header: Header) -> None:
        """Record a part of the topic that is not a duplicate."""
        if not self.outcomes.numbers:
            self.first_seen_stamp_nanos = header.stamp_nanos
        self.outcomes.mark_arrived(header.seq_number)

    def mark_delivered(self, key: MessageKey, size: int) -> None:
        """Record a delivered message; `mark_published` or `mark_dropped` follows."""
        if not self.outcomes.settle(key[0], "delivered"):
            return
        self._waiting[key] = size
        if len(self._waiting) > WAITING_KEPT:
            self._waiting.popitem(last=False)
            self.dropped += 1

    def mark_published(self, key: MessageKey, wall_nanos: int) -> None:
        """Record that a message reached its user at `wall_nanos` of the wall clock."""
        size = self._waiting.pop(key, None)
        if size is None:
            return  # from before a restart, or a repeated report
        stamp_nanos = key[1]
        if not self.published:
            self.first_stamp_nanos = stamp_nanos
        self.published += 1
        self.body_bytes += size
        self.last_stamp_nanos = stamp_nanos
        self._ages_nanos.append((wall_nanos, wall_nanos - stamp_nanos))

    def mark_dropped(self, key: MessageKey) -> None:
        """Record that a message will not reach its user."""
        self.dropped += self._waiting.pop(key, None) is not None

    def report(self, msg_type: int, duplicates: int, wall_nanos: int) -> TopicReport:
        """Return the report at this moment of the wall clock."""
        if self.since_nanos is None:
            self.since_nanos = wall_nanos
        while self._ages_nanos and wall_nanos - self._ages_nanos[0][0] > AGES_NANOS:
            self._ages_nanos.popleft()
        ages = sorted(age for _, age in self._ages_nanos)
        outcomes = self.outcomes
        return TopicReport(
            msg_type,
            outcomes.first_number,
            self.since_nanos,
            outcomes.numbers,
            self.published,
            self.dropped,
            outcomes.incomplete,
            outcomes.late,
            outcomes.open_count + len(self._waiting),
            outcomes.repaired,
            duplicates,
            self.body_bytes,
            self.first_seen_stamp_nanos,
            self.first_stamp_nanos,
            self.last_stamp_nanos,
            percentile(ages, 50),
            percentile(ages, 99),
        )


def percentile(ordered: List[int], percent: int) -> int:
    """Return the smallest of the sorted ages that `percent` of them do not exceed."""
    if not ordered:
        return NO_AGE
    return ordered[max(0, -(-len(ordered) * percent // 100) - 1)]
