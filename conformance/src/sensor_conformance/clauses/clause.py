# SPDX-License-Identifier: Apache-2.0
"""A clause: what data must be, where that is written, and the check of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from sensor_conformance.readings.base import TopicReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import ClausePlot


class Verdict(Enum):
    """What a check says."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class ClauseResult:
    """What a clause says of one topic."""

    verdict: Verdict
    line: str
    """The figures, in one line."""
    picture: ClausePlot | None = None


class NotTested(Exception):
    """The recording has nothing to observe the clause with; the text says what is missing."""


@dataclass(frozen=True)
class Clause:
    """What the data of a topic must be."""

    id: str
    """Family and name, such as ``imu.gravity``."""
    title: str
    """The requirement, as a sentence."""
    source: str
    """Where it is written: a REP, the definition of a message, the document of a driver."""
    applies_to: tuple[type[TopicReadings], ...]
    """Kinds of readings; `TopicReadings` stands for all topics with a header."""
    check: Callable[..., ClauseResult]
    """Judges one topic: gets its readings and the whole recording."""

    def applies(self, topic: TopicReadings) -> bool:
        """Say whether the clause is about a topic."""
        if not len(topic.received):
            return False
        if self.applies_to == (TopicReadings,):
            return bool(len(topic.stamps))
        return isinstance(topic, self.applies_to)

    def judge(self, topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
        """Check a topic."""
        try:
            return self.check(topic, recording)
        except NotTested as reason:
            return ClauseResult(Verdict.NOT_TESTED, str(reason))


def clause(
    id: str, title: str, source: str, *kinds: type[TopicReadings]
) -> Callable[[Callable[..., ClauseResult]], Clause]:
    """Turn a check into a clause.

    Parameters
    ----------
    id, title, source
        As in `Clause`.
    kinds
        Kinds of readings that it is about; all topics with a header by default.
    """

    def wrap(check: Callable[..., ClauseResult]) -> Clause:
        return Clause(id, title, source, kinds or (TopicReadings,), check)

    return wrap


def result(holds: bool, line: str, picture: ClausePlot | None = None) -> ClauseResult:
    """Return passed or failed, with the figures."""
    return ClauseResult(Verdict.PASSED if holds else Verdict.FAILED, line, picture)


def findings(
    found: Sequence[str], otherwise: str, picture: ClausePlot | None = None
) -> ClauseResult:
    """Return failed with all findings in one line, or passed."""
    more = f" (and {len(found) - 3} more)" if len(found) > 3 else ""
    return result(not found, "; ".join(found[:3]) + more if found else otherwise, picture)
