# SPDX-License-Identifier: Apache-2.0
"""Judge a recording: every clause, for every topic that it is about."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from .clauses import TABLE
from .clauses.clause import Clause, ClauseResult, Verdict
from .readings.recording import CheckedRecording
from .sources.bag import BagSource
from .sources.pcap import PcapSource
from .sources.source import MessageSource


@dataclass(frozen=True)
class CheckResult:
    """What one clause says of one topic."""

    clause: Clause
    topic: str
    result: ClauseResult


@dataclass(frozen=True)
class CheckReport:
    """What all clauses say of a recording."""

    name: str
    topics: tuple[tuple[str, str, int], ...]
    """Name, type and number of messages."""
    unread: dict[str, str]
    """Topics that could not be read, and why."""
    results: tuple[CheckResult, ...]

    @property
    def findings(self) -> list[CheckResult]:
        """Clauses that do not hold."""
        return [one for one in self.results if one.result.verdict is Verdict.FAILED]

    def counts(self) -> Counter[Verdict]:
        """Return how often each verdict occurs."""
        return Counter(one.result.verdict for one in self.results)


def is_selected(clause: Clause, topic: str, only: Sequence[str], skip: Sequence[str]) -> bool:
    """Say whether a clause is to be checked for a topic.

    Parameters
    ----------
    clause, topic
        The clause, and the name of the topic.
    only, skip
        Patterns such as ``imu.*``, or with a topic behind an @: ``stamps.jitter@/camera/*``.
    """

    def matches(pattern: str) -> bool:
        name, _, place = pattern.partition("@")
        return fnmatch(clause.id, name) and fnmatch(topic, place or "*")

    return (not only or any(map(matches, only))) and not any(map(matches, skip))


def check_recording(
    recording: CheckedRecording, only: Sequence[str] = (), skip: Sequence[str] = ()
) -> CheckReport:
    """Judge a recording that was read.

    Parameters
    ----------
    recording
        Readings of all topics.
    only, skip
        Patterns of clauses, see `is_selected`.
    """
    results = [
        CheckResult(clause, topic.name, clause.judge(topic, recording))
        for clause in TABLE
        for topic in recording.topics
        if clause.applies(topic) and is_selected(clause, topic.name, only, skip)
    ]
    topics = [(topic.name, topic.type, len(topic.received)) for topic in recording.topics]
    return CheckReport(recording.name, tuple(topics), recording.unread, tuple(results))


def check_source(
    source: MessageSource, only: Sequence[str] = (), skip: Sequence[str] = ()
) -> CheckReport:
    """Read a source to its end and judge it."""
    return check_recording(CheckedRecording.read(source), only, skip)


def check_file(
    path: Path, only: Sequence[str] = (), skip: Sequence[str] = (), duration: float | None = None
) -> CheckReport:
    """Read a bag or a capture of datagrams, and judge it.

    Parameters
    ----------
    path
        Bag of ROS 1 or ROS 2, MCAP file, or ``.pcap``.
    only, skip
        Patterns of clauses, see `is_selected`.
    duration
        Seconds of a bag to read from the beginning; all by default.

    Raises
    ------
    UnreadableSource
        If the file is none of these.
    """
    if path.suffix == ".pcap":
        return check_source(PcapSource(path), only, skip)
    with BagSource(path, duration) as source:
        return check_source(source, only, skip)
