# SPDX-License-Identifier: Apache-2.0
"""First difference between the recordings of two runs, such as the last good and the first bad one.

Messages of a topic are compared in their order. Sensors of both runs may differ: a topic of one
recording alone is a difference at its first message.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import NamedTuple

from msgspec import Struct

from groundlink.core.clock import NANOS
from groundlink.ros.base import made_topics
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from groundlink.ros.streams import faults_topic, incoming, missing_readings_topic

from .differences import message_difference
from .reader import RecordedMessage, Recording
from .verifying import UNDER_WAY_NANOS


class RunDifference(Struct, frozen=True):
    """The first difference between two runs."""

    topic: str
    sim_seconds: float
    """Time since the start of the run."""

    number: int
    """Number of the message within its topic, from 1."""

    field: str
    """Path of the field; empty where one of the runs has no such message."""

    first: str
    """Value in the first run, as text."""

    second: str


class _Instant(NamedTuple):
    """The messages of one time."""

    nanos: int
    """Since the start of the run."""

    messages: Mapping[str, list[RecordedMessage]]
    """By topic."""


def first_run_difference(first: Recording, second: Recording) -> RunDifference | None:
    """Return the first difference of two runs, in the time that both recordings cover.

    Of several at one time, that of a command or another input comes first. What does not come from
    the scenario and the inputs alone, and what the gateway computes of other topics, is ignored.
    """
    recordings = (first, second)
    spans = [_span(recording) for recording in recordings]
    begin_nanos = max(span.begin_nanos for span in spans)
    whole_to_nanos = min(span.whole_to_nanos for span in spans)
    end_nanos = min(span.end_nanos for span in spans)
    ignored = {topic for recording in recordings for topic in _ignored(recording)}
    inputs = [stream.topic for stream in incoming(first.run.scenario, first.run.run)]
    instants = [_instants(each, begin_nanos, end_nanos, ignored) for each in recordings]
    numbers: Counter[str] = Counter()
    one, other = (next(each, None) for each in instants)
    while one or other:
        nanos = min(instant.nanos for instant in (one, other) if instant)
        now = [i.messages if i and i.nanos == nanos else {} for i in (one, other)]
        topics = sorted({*now[0], *now[1]}, key=lambda topic: (topic not in inputs, topic))
        for topic in topics:
            messages = [each.get(topic, []) for each in now]
            if found := _difference(*messages, may_lack=nanos >= whole_to_nanos):
                number, field, values = found
                return RunDifference(topic, nanos / NANOS, numbers[topic] + number, field, *values)
            numbers[topic] += len(messages[0])
        if one and one.nanos == nanos:
            one = next(instants[0], None)
        if other and other.nanos == nanos:
            other = next(instants[1], None)
    return None


class _Span(NamedTuple):
    """The time that a recording covers, since the start of its run."""

    begin_nanos: int
    whole_to_nanos: int
    """Messages after may be missing, since they were in transit at the end."""

    end_nanos: int
    """Exclusive."""


def _span(recording: Recording) -> _Span:
    epoch_nanos, first_nanos = recording.run.epoch_nanos, recording.first_nanos
    begin_nanos = first_nanos + (UNDER_WAY_NANOS if first_nanos > epoch_nanos else 0)
    if (end_nanos := recording.end_nanos) is not None:
        span = (begin_nanos, end_nanos, end_nanos)
    else:
        last_nanos = recording.last_nanos
        span = (begin_nanos, last_nanos - UNDER_WAY_NANOS, last_nanos + 1)
    return _Span(*(nanos - epoch_nanos for nanos in span))


def _ignored(recording: Recording) -> Iterator[str]:
    scenario = recording.run.scenario
    yield DIAGNOSTICS_TOPIC
    yield from made_topics(scenario)
    for name in scenario.sensor_names():
        yield from (faults_topic(name), missing_readings_topic(name))


def _instants(
    recording: Recording, begin_nanos: int, end_nanos: int, ignored: set[str]
) -> Iterator[_Instant]:
    epoch_nanos = recording.run.epoch_nanos
    topics = [topic for topic in recording.types if topic not in ignored]
    messages = recording.read(topics, from_nanos=epoch_nanos + begin_nanos) if topics else ()
    for nanos, group in groupby(messages, key=lambda message: message.nanos):
        if nanos - epoch_nanos >= end_nanos:
            return
        by_topic: dict[str, list[RecordedMessage]] = {}
        for message in group:
            by_topic.setdefault(message.topic, []).append(message)
        yield _Instant(nanos - epoch_nanos, by_topic)


def _difference(
    first: list[RecordedMessage], second: list[RecordedMessage], *, may_lack: bool
) -> tuple[int, str, tuple[str, str]] | None:
    """Return number, field and values of the first difference of one topic at one time.

    A missing message is none where messages may be missing.
    """
    for number, (one, other) in enumerate(zip(first, second, strict=False), 1):
        if one.cdr != other.cdr:
            found = message_difference(one.ros_type, one.cdr, other.cdr)
            return number, found.field, (found.recorded, found.repeated)
    if len(first) == len(second) or may_lack:
        return None
    words = ("a message", "no message")
    number = min(len(first), len(second)) + 1
    return number, "", words if len(first) > len(second) else (words[1], words[0])
