# SPDX-License-Identifier: Apache-2.0
"""What became of all that was sent to one destination, topic by topic: sums that add up.

A sender knows what it sent, its receiver reports what came of it. Either side may be restarted:
the receiver's counts then begin anew and are added to what it had reported before. Time is an
argument; nothing here sends.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Dict, List, NamedTuple, Optional, Tuple

from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, SIGNED_SEQ_NUMBERS
from udp_bridge.wire.message import Message
from udp_bridge.wire.reports import TopicReport

TOPICS_KEPT = 4096
SETTLED_NANOS = 4 * NANOS
"""What was sent this long ago and never reported is missing: a receiver gives up after 2 s, and
reports a second later."""
_MARK_NANOS = NANOS // 4
_STALE_NANOS = 5 * NANOS
"""A report behind a newer one by up to this much was overtaken; by more, the clock was set."""


class Account(NamedTuple):
    """One topic: `sent` = delivered + dropped + incomplete + late + missing + in_flight."""

    msg_type: int
    topic: str
    sent: int
    """Messages that got a number, since this sender began."""
    sent_bytes: int
    """Their bodies."""
    superseded: int
    """Messages that a newer one pushed out before they were sent; no part of `sent`."""
    delivered: int
    """Messages that reached the receiver's user, such as a publisher of ROS."""
    dropped: int
    """Whole messages that the receiver's user did not take, or not in time."""
    incomplete: int
    late: int
    missing: int
    """Messages of which the receiver has told nothing, and will not any more."""
    in_flight: int
    """Messages on their way, awaiting parts, waiting at the receiver, or not yet reported."""
    repaired: int
    """Of those delivered or dropped, the ones that would be incomplete without repair."""
    delivered_bytes: int
    report: Optional[TopicReport]
    """The newest report, whose counts are of the receiver's life alone."""


def arrived(topic: str, report: TopicReport) -> Account:
    """Return the account of what came from a peer, of which this end knows all but what was sent.

    `sent` are then the messages from the first to the last one that is known of.
    """
    return Account(
        report.msg_type,
        topic,
        sent=report.numbers,
        sent_bytes=0,
        superseded=0,
        delivered=report.published,
        dropped=report.dropped,
        incomplete=report.incomplete,
        late=report.late,
        missing=report.missing,
        in_flight=report.pending,
        repaired=report.repaired,
        delivered_bytes=report.body_bytes,
        report=report,
    )


_SUMMED = ("published", "dropped", "incomplete", "late", "repaired", "body_bytes")


class _Sent:
    """One topic's sums."""

    def __init__(self, stamp_nanos: int) -> None:
        self.sent = self.sent_bytes = self.superseded = 0
        self.oldest_stamp_nanos = stamp_nanos
        self.report: Optional[TopicReport] = None
        self.told_nanos = 0  # the receiver's wall clock at the newest report
        self.before = dict.fromkeys(_SUMMED, 0)  # by receivers whose counts have ended
        self.end = 0  # numbers below this one have been reported on
        self.settled = 0  # numbers below this one were sent long ago
        self.marks: Deque[Tuple[int, int]] = deque()  # when, and what was sent until then

    def mark(self, now_nanos: int) -> None:
        if not self.marks or now_nanos - self.marks[-1][0] >= _MARK_NANOS:
            self.marks.append((now_nanos, self.sent))
        while self.marks and now_nanos - self.marks[0][0] >= SETTLED_NANOS:
            self.settled = self.marks.popleft()[1]

    def take(self, report: TopicReport, told_nanos: int) -> None:
        if 0 < self.told_nanos - told_nanos <= _STALE_NANOS:
            return
        last = self.sent - 1
        first = last - (last - report.first_number) % SEQ_NUMBERS
        is_own = 0 <= first and first + report.numbers <= self.sent
        if not is_own or report.first_seen_stamp_nanos < self.oldest_stamp_nanos:
            return  # of a sender that was here before
        if self.report is not None and report.since_nanos != self.report.since_nanos:
            for name in _SUMMED:
                self.before[name] += getattr(self.report, name)
        self.report, self.told_nanos = report, told_nanos
        self.end = max(self.end, first + report.numbers)

    def sums(self, key: Tuple[int, str]) -> Account:
        sums = dict(self.before)
        pending = 0
        if self.report is not None:
            pending = self.report.pending
            for name in _SUMMED:
                sums[name] += getattr(self.report, name)
        come = sums["published"] + sums["dropped"] + sums["incomplete"] + sums["late"]
        in_flight = pending + max(0, self.sent - max(self.end, self.settled))
        # Sent again or copied, a message may find a second fate at a receiver's successor.
        excess = max(0, come + in_flight - self.sent)
        for name in ("incomplete", "late", "dropped", "published"):
            taken = min(excess, sums[name])
            sums[name] -= taken
            come -= taken
            excess -= taken
        return Account(
            *key,
            self.sent,
            self.sent_bytes,
            self.superseded,
            sums["published"],
            sums["dropped"],
            sums["incomplete"],
            sums["late"],
            self.sent - come - in_flight,
            in_flight,
            sums["repaired"],
            sums["body_bytes"],
            self.report,
        )


class Accounts:
    """The accounts of one destination; the topics that were quiet for the longest give way.

    One that was forgotten begins at number 0, like that of a sender which was restarted.
    """

    def __init__(self, *, signed_peer: bool = False) -> None:
        self._modulus = SIGNED_SEQ_NUMBERS if signed_peer else SEQ_NUMBERS
        self._topics: OrderedDict[Tuple[int, str], _Sent] = OrderedDict()

    def numbered(self, key: Tuple[int, str], stamp_nanos: int, size: int) -> int:
        """Return the seq_number of a message that leaves: how many of its topic left before it.

        Parameters
        ----------
        key
            Its msg_type and topic.
        stamp_nanos, size
            Its stamp, and the bytes of its body.
        """
        row = self._topics.get(key) or self._new_row(key, stamp_nanos)
        self._topics.move_to_end(key)
        number = row.sent % self._modulus
        row.sent += 1
        row.sent_bytes += size
        if stamp_nanos < row.oldest_stamp_nanos:
            row.oldest_stamp_nanos = stamp_nanos
        return number

    def superseded(self, message: Message) -> None:
        """Take note of a message that is not sent, for a newer one came."""
        key = (message.msg_type, message.topic)
        row = self._topics.get(key) or self._new_row(key, message.stamp_nanos)
        row.superseded += 1

    def reported(self, topic: str, report: TopicReport, told_nanos: int) -> None:
        """Take what the receiver reports; its wall clock said `told_nanos`."""
        row = self._topics.get((report.msg_type, topic))
        if row is not None and row.sent:
            row.take(report, told_nanos)

    def left(self) -> Dict[Tuple[int, str], int]:
        """Return how many messages of each topic have left, by msg_type and topic."""
        return {key: row.sent for key, row in self._topics.items()}

    def rows(self, now_nanos: int) -> List[Account]:
        """Return the accounts at this moment; to be asked about once a second."""
        for row in self._topics.values():
            row.mark(now_nanos)
        return [row.sums(key) for key, row in self._topics.items()]

    def _new_row(self, key: Tuple[int, str], stamp_nanos: int) -> _Sent:
        if len(self._topics) >= TOPICS_KEPT:
            self._topics.popitem(last=False)
        row = self._topics[key] = _Sent(stamp_nanos)
        return row
