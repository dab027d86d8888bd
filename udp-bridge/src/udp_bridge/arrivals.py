# SPDX-License-Identifier: Apache-2.0
"""What arrived from one sender, topic by topic, for the reports that go back to it.

Time is an argument. What did not arrive is the reassembler's to count; here it is only
put beside what did.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Deque, Iterable, List, Tuple

from .control import NO_AGE, TopicReport
from .counters import Counters
from .message import Message

TOPICS_REPORTED = 1024
"""Topics and links of a sender that are kept; the oldest gives way."""
AGES_KEPT = 4096
"""Ages between two reports; ten times what a 400 Hz topic brings in a second."""

Tally = Tuple[int, str, str, Counters]
"""msg_type, topic, link last seen and counters of a topic: `Reassembler.tallies`."""


class _Arrived:
    """What arrived of one topic with one link."""

    def __init__(self, stamp_nanos: int) -> None:
        self.messages = 0
        self.first_stamp_nanos = self.last_stamp_nanos = stamp_nanos
        self.ages_nanos: Deque[int] = deque(maxlen=AGES_KEPT)

    def median_age_nanos(self) -> int:
        ages = sorted(self.ages_nanos)
        return ages[len(ages) // 2] if ages else NO_AGE


class Arrivals:
    """Keeps count and age of the messages of one sender."""

    def __init__(self) -> None:
        self._arrived: OrderedDict[Tuple[int, str, str], _Arrived] = OrderedDict()

    def arrived(self, message: Message, wall_nanos: int) -> None:
        """Take note of a message that was handed over when the wall clock said `wall_nanos`."""
        key = (message.msg_type, message.topic, message.link)
        row = self._arrived.get(key)
        if row is None:
            if len(self._arrived) >= TOPICS_REPORTED:
                self._arrived.popitem(last=False)
            row = self._arrived[key] = _Arrived(message.stamp_nanos)
        row.messages += 1
        row.last_stamp_nanos = message.stamp_nanos
        row.ages_nanos.append(wall_nanos - message.stamp_nanos)

    def reports(self, tallies: Iterable[Tally] = ()) -> List[Tuple[str, str, TopicReport]]:
        """Return topic, link and report of each; the next report's ages start from here.

        Parameters
        ----------
        tallies
            Losses by topic. A topic of which nothing ever became whole is reported, too.
        """
        losses = {(msg_type, topic): (link, lost) for msg_type, topic, link, lost in tallies}
        rows = dict(self._arrived)
        for (msg_type, topic), (link, _) in losses.items():
            if not any(key[:2] == (msg_type, topic) for key in rows):
                rows[msg_type, topic, link] = _Arrived(0)
        reports = []
        nothing = ("", Counters())
        for (msg_type, topic, link), row in rows.items():
            lost = losses.get((msg_type, topic), nothing)[1]
            report = TopicReport(
                msg_type,
                row.messages,
                lost.missing,
                lost.incomplete,
                lost.late,
                lost.duplicates,
                row.first_stamp_nanos,
                row.last_stamp_nanos,
                row.median_age_nanos(),
            )
            row.ages_nanos.clear()
            reports.append((topic, link, report))
        return reports
