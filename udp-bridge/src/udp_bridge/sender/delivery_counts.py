# SPDX-License-Identifier: Apache-2.0
"""Delivery counts: the outcome of all messages sent to one destination, by topic.

The sender counts what it sent and the receiver reports the outcomes; together they add up. If the
receiver restarts, its counts begin again at zero and are added to those reported before.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Dict, List, NamedTuple, Optional, Tuple

from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, SIGNED_SEQ_NUMBERS
from udp_bridge.wire.message import Message, TopicKey
from udp_bridge.wire.reports import TopicReport

MAX_TOPICS = 4096
SETTLED_NANOS = 4 * NANOS
"""A message sent this long ago and never reported is missing: a receiver gives up after 2 s and
reports within another second."""
_MARK_NANOS = NANOS // 4
_STALE_NANOS = 5 * NANOS
"""A report that is older than the newest by up to this was reordered; by more, the receiver's
clock was set."""


class DeliveryCounts(NamedTuple):
    """One topic: `sent` = delivered + dropped + incomplete + late + missing + in_flight."""

    msg_type: int
    topic: str
    sent: int
    """Messages that got a sequence number since this sender started."""
    sent_bytes: int
    """Bytes of their bodies."""
    superseded: int
    """Messages replaced by a newer one before they were sent; not part of `sent`."""
    delivered: int
    """Messages that reached the receiver's application, such as a ROS publisher."""
    dropped: int
    """Complete messages that the receiver's application did not take, or not in time."""
    incomplete: int
    late: int
    missing: int
    """Messages that a receiver with reports did not report in time."""
    in_flight: int
    """Messages on the way, being reassembled, queued at the receiver, or not reported yet."""
    repaired: int
    """Delivered or dropped messages that would be incomplete without repair."""
    delivered_bytes: int
    report: Optional[TopicReport]
    """The newest report; it counts from the receiver's start."""


def received_counts(topic: str, report: TopicReport) -> DeliveryCounts:
    """Return the counts of a topic that this end receives.

    `sent` is then the number of messages from the first to the last one received.
    """
    return DeliveryCounts(
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


class _TopicCounter:
    """Counts of one topic."""

    def __init__(self, stamp_nanos: int) -> None:
        self.sent = self.sent_bytes = self.superseded = 0
        self.oldest_stamp_nanos = stamp_nanos
        self.report: Optional[TopicReport] = None
        self.reported_nanos = 0  # the receiver's wall clock at the newest report
        self.before = dict.fromkeys(_SUMMED, 0)  # from before restarts of the receiver
        self.end = 0  # lower numbers were reported
        self.settled = 0  # lower numbers were sent long ago
        self.marks: Deque[Tuple[int, int]] = deque()  # time, and messages sent until then

    def mark(self, now_nanos: int) -> None:
        if not self.marks or now_nanos - self.marks[-1][0] >= _MARK_NANOS:
            self.marks.append((now_nanos, self.sent))
        while self.marks and now_nanos - self.marks[0][0] >= SETTLED_NANOS:
            self.settled = self.marks.popleft()[1]

    def take(self, report: TopicReport, reported_nanos: int) -> None:
        if 0 < self.reported_nanos - reported_nanos <= _STALE_NANOS:
            return
        last = self.sent - 1
        first = last - (last - report.first_number) % SEQ_NUMBERS
        is_own = 0 <= first and first + report.numbers <= self.sent
        if not is_own or report.first_seen_stamp_nanos < self.oldest_stamp_nanos:
            return  # it is about an earlier sender at this address
        if self.report is not None and report.since_nanos != self.report.since_nanos:
            for name in _SUMMED:
                self.before[name] += getattr(self.report, name)
        self.report, self.reported_nanos = report, reported_nanos
        self.end = max(self.end, first + report.numbers)

    def counts(self, key: TopicKey, *, is_settled: bool) -> DeliveryCounts:
        """Return the counts; without `is_settled` what was not reported is in flight."""
        sums = dict(self.before)
        pending = 0
        if self.report is not None:
            pending = self.report.pending
            for name in _SUMMED:
                sums[name] += getattr(self.report, name)
        settled = sums["published"] + sums["dropped"] + sums["incomplete"] + sums["late"]
        in_flight = pending + max(0, self.sent - max(self.end, self.settled if is_settled else 0))
        # A message that was resent or duplicated may be counted again by a restarted receiver.
        excess = max(0, settled + in_flight - self.sent)
        for name in ("incomplete", "late", "dropped", "published"):
            taken = min(excess, sums[name])
            sums[name] -= taken
            settled -= taken
            excess -= taken
        return DeliveryCounts(
            *key,
            self.sent,
            self.sent_bytes,
            self.superseded,
            sums["published"],
            sums["dropped"],
            sums["incomplete"],
            sums["late"],
            self.sent - settled - in_flight,
            in_flight,
            sums["repaired"],
            sums["body_bytes"],
            self.report,
        )


class DeliveryCounter:
    """Gives messages their sequence numbers and counts the outcomes, for one destination.

    At most `MAX_TOPICS` are kept: the longest idle one is forgotten and begins again at number 0,
    as after a restart of the sender.
    """

    def __init__(self, *, signed_peer: bool = False) -> None:
        self._modulus = SIGNED_SEQ_NUMBERS if signed_peer else SEQ_NUMBERS
        self._topics: OrderedDict[TopicKey, _TopicCounter] = OrderedDict()
        self._is_reported = False  # A receiver may send no reports: nothing is missing then.

    def upcoming(self, key: TopicKey) -> int:
        """Return what `next_number` will return."""
        counter = self._topics.get(key)
        return counter.sent % self._modulus if counter is not None else 0

    def next_number(self, key: TopicKey, stamp_nanos: int, size: int) -> int:
        """Count a message with a body of `size` bytes; return its seq_number."""
        counter = self._topics.get(key) or self._add(key, stamp_nanos)
        self._topics.move_to_end(key)
        number = counter.sent % self._modulus
        counter.sent += 1
        counter.sent_bytes += size
        if stamp_nanos < counter.oldest_stamp_nanos:
            counter.oldest_stamp_nanos = stamp_nanos
        return number

    def superseded(self, message: Message) -> None:
        """Count a message that is not sent because a newer one replaced it."""
        key = (message.msg_type, message.topic)
        counter = self._topics.get(key) or self._add(key, message.stamp_nanos)
        counter.superseded += 1

    def reported(self, topic: str, report: TopicReport, reported_nanos: int) -> None:
        """Take a report; `reported_nanos` is the receiver's wall clock."""
        self._is_reported = True
        counter = self._topics.get((report.msg_type, topic))
        if counter is not None and counter.sent:
            counter.take(report, reported_nanos)

    def sent(self) -> Dict[TopicKey, int]:
        """Return the number of messages sent, by topic."""
        return {key: counter.sent for key, counter in self._topics.items()}

    def counts(self, now_nanos: int) -> List[DeliveryCounts]:
        """Return the counts of all topics; call it about once a second."""
        for counter in self._topics.values():
            counter.mark(now_nanos)
        is_settled = self._is_reported
        return [counter.counts(key, is_settled=is_settled) for key, counter in self._topics.items()]

    def _add(self, key: TopicKey, stamp_nanos: int) -> _TopicCounter:
        if len(self._topics) >= MAX_TOPICS:
            self._topics.popitem(last=False)
        counter = self._topics[key] = _TopicCounter(stamp_nanos)
        return counter
