# SPDX-License-Identifier: Apache-2.0
"""Comparison of a recording with the messages of a repeated run.

Messages with the same topic and time belong together and are compared byte by byte. The recording
is read along with the run, so memory does not grow with its length. Messages missing for a recorded
cause, and messages in transit at the edges of the recording, are counted and are no difference.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

from msgspec import Struct

from groundlink.core.clock import NANOS

from .differences import message_difference
from .reader import RecordedMessage

WAIT_NANOS = 10 * NANOS
"""How far the run may be ahead of a message that was recorded and has not come again."""


class FirstDifference(Struct, frozen=True):
    """The first difference of a topic."""

    nanos: int
    """Log time: the run's time."""

    number: int
    """Of the message among those of its topic that were recorded, from 1 on; where it was not
    recorded, of the next one; 0 where all of the topic differs."""

    words: str
    """The field and both values."""


class TopicComparison(Struct, kw_only=True):
    """What became of one topic."""

    topic: str
    type: str
    recorded: int = 0
    equal: int = 0
    different: int = 0
    missing: int = 0
    """Recorded, and not there again."""

    new: int = 0
    """There again, and not recorded."""

    left_out: dict[str, int] = {}
    """There again, and left out at that time for causes that were recorded."""

    ragged: int = 0
    """There again, and under way when the recording began or was ended."""

    first: FirstDifference | None = None

    @property
    def is_equal(self) -> bool:
        """Whether no message differs."""
        return self.first is None


class ComparedSpan(NamedTuple):
    """What of a recording is compared."""

    first_nanos: int
    end_nanos: int
    """Of the first message that is not."""

    whole_from_nanos: int
    """What is earlier may not have been heard yet when the recording began."""

    whole_to_nanos: int
    """What is later may have been under way when the recording was ended."""


class Comparison:
    """Compares what comes with what was recorded.

    Parameters
    ----------
    recorded
        what is to be compared, in the order of time.
    left_out
        says for a topic and an instant why no message was published then; None for no reason.
    """

    def __init__(
        self,
        recorded: Iterator[RecordedMessage],
        extent: ComparedSpan,
        left_out: Callable[[str, int], str | None],
    ) -> None:
        self._recorded, self._extent, self._left_out = recorded, extent, left_out
        self._next = next(recorded, None)
        self._topics: dict[str, _Topic] = {}

    def declare(self, topic: str, ros_type: str, is_recorded: bool) -> None:
        """Take note of a topic of the run, whether something comes of it or not."""
        if not is_recorded:
            found = self._topic(topic, ros_type)
            found.note(self._extent.first_nanos, 0, "the topic is not in the recording")

    def take(self, topic: str, ros_type: str, nanos: int, cdr: memoryview) -> None:
        """Compare a message."""
        if not self._extent.first_nanos <= nanos < self._extent.end_nanos:
            return
        self._read_to(nanos)
        found = self._topic(topic, ros_type)
        if not found.take(nanos, bytes(cdr)):
            self._judge_new(found, topic, nanos)

    def verdicts(self) -> list[TopicComparison]:
        """Return what became of every topic, when nothing more will come."""
        self._read_to(self._extent.end_nanos)
        for topic in self._topics.values():
            topic.give_up(self._extent.end_nanos)
        return [topic.verdict for _, topic in sorted(self._topics.items())]

    def _judge_new(self, found: _Topic, topic: str, nanos: int) -> None:
        verdict = found.verdict
        if cause := self._left_out(topic, nanos):
            verdict.left_out[cause] = verdict.left_out.get(cause, 0) + 1
            return
        if nanos >= self._extent.whole_to_nanos:
            self._read_to(self._extent.end_nanos)
        before = nanos < self._extent.whole_from_nanos and found.number == 0
        if before or (nanos >= self._extent.whole_to_nanos and found.has_ended):
            verdict.ragged += 1
            return
        verdict.new += 1
        found.note(nanos, found.number + 1, "not recorded, and there again")

    def _read_to(self, nanos: int) -> None:
        """Read what was recorded up to an instant."""
        while (recorded := self._next) is not None and recorded.nanos <= nanos:
            self._next = next(self._recorded, None)
            if recorded.nanos < self._extent.end_nanos:
                self._topic(recorded.topic, recorded.ros_type).expect(recorded.nanos, recorded.cdr)

    def _topic(self, name: str, ros_type: str) -> _Topic:
        found = self._topics.get(name)
        if found is None:
            found = self._topics[name] = _Topic(TopicComparison(topic=name, type=ros_type))
        return found


class _Topic:
    """One topic, and what of it was recorded and has not come again yet."""

    def __init__(self, verdict: TopicComparison) -> None:
        self.verdict = verdict
        self._waiting: deque[tuple[int, bytes]] = deque()
        self.number = 0
        """Of the last message that was recorded and judged."""

    @property
    def has_ended(self) -> bool:
        """Whether, as far as the recording has been read, nothing more was recorded."""
        return not self._waiting

    def expect(self, nanos: int, cdr: bytes) -> None:
        """Take note of what was recorded; what did not come again for long will not come."""
        self.verdict.recorded += 1
        self._waiting.append((nanos, cdr))
        self.give_up(nanos - WAIT_NANOS)

    def give_up(self, before_nanos: int) -> None:
        """Count as missing what was recorded before an instant and has not come again."""
        while self._waiting and self._waiting[0][0] < before_nanos:
            nanos, _ = self._waiting.popleft()
            self.number += 1
            self.verdict.missing += 1
            self.note(nanos, self.number, "recorded, and not there again")

    def take(self, nanos: int, cdr: bytes) -> bool:
        """Compare a message; return False where none was recorded of that instant."""
        self.give_up(nanos)
        if not self._waiting or self._waiting[0][0] > nanos:
            return False
        _, recorded = self._waiting.popleft()
        self.number += 1
        if recorded == cdr:
            self.verdict.equal += 1
        else:
            self.verdict.different += 1
            if self.verdict.first is None:
                words = str(message_difference(self.verdict.type, recorded, cdr))
                self.note(nanos, self.number, words)
        return True

    def note(self, nanos: int, number: int, words: str) -> None:
        """Remember the first difference."""
        if self.verdict.first is None:
            self.verdict.first = FirstDifference(nanos, number, words)
