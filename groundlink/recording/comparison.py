# SPDX-License-Identifier: Apache-2.0
"""Comparison of a recording with the messages of a repeated run.

Messages with the same topic and time belong together and are compared byte by byte. The recording
is read along with the run, so memory does not grow with its length. Messages missing for a recorded
cause, and messages in transit at the edges of the recording, are counted and are no difference.
"""

from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

from msgspec import Struct

from groundlink.core.clock import NANOS

from .differences import message_difference
from .reader import RecordedMessage

WAIT_NANOS = 10 * NANOS
"""Maximum lead of the run over a recorded message that has not been repeated."""


class FirstDifference(Struct, frozen=True):
    """The first difference of a topic."""

    nanos: int
    """Log time, in the time of the run."""

    number: int
    """Number of the recorded message within its topic, from 1; of the next one for a new message;
    0 if the whole topic differs."""

    words: str
    """The field and both values, as text."""


class TopicComparison(Struct, kw_only=True):
    """Result of the comparison of one topic."""

    topic: str
    type: str
    recorded: int = 0
    equal: int = 0
    different: int = 0
    missing: int = 0
    """Messages recorded and not repeated."""

    new: int = 0
    """Messages repeated and not recorded."""

    left_out: dict[str, int] = {}
    """Repeated messages whose recording was missing for a recorded cause, by cause."""

    ragged: int = 0
    """Repeated messages in transit when the recording began or ended."""

    first: FirstDifference | None = None

    @property
    def is_equal(self) -> bool:
        """Whether no message differs."""
        return self.first is None


class ComparedSpan(NamedTuple):
    """Compared time span of a recording."""

    first_nanos: int
    end_nanos: int
    """End of the span, exclusive."""

    whole_from_nanos: int
    """Messages before may be missing, since subscriptions were not yet active."""

    whole_to_nanos: int
    """Messages after may be missing, since they were in transit at the end."""


class Comparison:
    """Compares the messages of a run with a recording.

    Parameters
    ----------
    recorded
        recorded messages in order of time.
    left_out
        returns why a topic has no message of an instant; None for no known cause.
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
        """Declare a topic of the run, with or without messages."""
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
        """Finish the comparison and return the result of every topic."""
        self._read_to(self._extent.end_nanos)
        for topic in self._topics.values():
            topic.give_up(self._extent.end_nanos)
        return [topic.verdict for _, topic in sorted(self._topics.items())]

    def _judge_new(self, found: "_Topic", topic: str, nanos: int) -> None:
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
        found.note(nanos, found.number + 1, "not recorded, but published in the repeated run")

    def _read_to(self, nanos: int) -> None:
        """Read the recording up to an instant."""
        while (recorded := self._next) is not None and recorded.nanos <= nanos:
            self._next = next(self._recorded, None)
            if recorded.nanos < self._extent.end_nanos:
                self._topic(recorded.topic, recorded.ros_type).expect(recorded.nanos, recorded.cdr)

    def _topic(self, name: str, ros_type: str) -> "_Topic":
        found = self._topics.get(name)
        if found is None:
            found = self._topics[name] = _Topic(TopicComparison(topic=name, type=ros_type))
        return found


class _Topic:
    """State of one topic with its recorded messages not yet repeated."""

    def __init__(self, verdict: TopicComparison) -> None:
        self.verdict = verdict
        self._waiting: deque[tuple[int, bytes]] = deque()
        self.number = 0
        """Number of the last recorded message compared."""

    @property
    def has_ended(self) -> bool:
        """Whether no recorded message is left, as far as the recording has been read."""
        return not self._waiting

    def expect(self, nanos: int, cdr: bytes) -> None:
        """Add a recorded message, and give up on messages older than `WAIT_NANOS`."""
        self.verdict.recorded += 1
        self._waiting.append((nanos, cdr))
        self.give_up(nanos - WAIT_NANOS)

    def give_up(self, before_nanos: int) -> None:
        """Count recorded messages before an instant as missing."""
        while self._waiting and self._waiting[0][0] < before_nanos:
            nanos, _ = self._waiting.popleft()
            self.number += 1
            self.verdict.missing += 1
            self.note(nanos, self.number, "recorded, but missing in the repeated run")

    def take(self, nanos: int, cdr: bytes) -> bool:
        """Compare a message; return False if none of that instant was recorded."""
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
