# SPDX-License-Identifier: Apache-2.0
"""Verdicts on the expectations of a recorded run, from the recording alone."""

from collections.abc import Callable
from typing import Any

from groundlink.core.clock import NANOS
from groundlink.expectations.judge import ExpectationJudge
from groundlink.expectations.results import ExpectationResult
from groundlink.expectations.trackers import TopicFigures
from groundlink.messages.base import BadBusMessage
from groundlink.ros.cdr import from_cdr
from groundlink.ros.codec import Moment
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from groundlink.ros.types import STORE
from groundlink.scenario import Scenario

from .reader import RecordedMessage, Recording

PROGRESS_MESSAGES = 1_000
"""Messages between progress updates."""


def judged(
    recording: Recording,
    scenario: Scenario,
    progress: Callable[[float], object] = lambda share: None,
) -> list[ExpectationResult]:
    """Return the results of a scenario's expectations; `progress` gets the share that is read.

    Parameters
    ----------
    scenario
        checked scenario of the recording, with its own or other expectations.
    """
    if not scenario.expect:
        return []
    judge = ExpectationJudge(scenario, recording.run.run)
    streams = {stream.topic: stream for stream in judge.streams.values()}
    epoch_nanos = recording.run.epoch_nanos
    recorded = recording.topics.items()
    judge.recorded({topic: TopicFigures(facts.measured_hz) for topic, facts in recorded})
    wanted = [*streams, *([DIAGNOSTICS_TOPIC] if judge.topics else [])]
    span = max(recording.last_nanos - recording.first_nanos, 1)
    for number, message in enumerate(recording.read(wanted)):
        if number % PROGRESS_MESSAGES == 0:
            progress((message.nanos - recording.first_nanos) / span)
        if message.topic == DIAGNOSTICS_TOPIC:
            if figures := _reported(message):
                judge.reported((message.nanos - epoch_nanos) / NANOS, figures)
            continue
        stream = streams[message.topic]
        try:
            found = from_cdr(message.cdr, stream.message, Moment(message.nanos, epoch_nanos))
        except BadBusMessage:
            continue
        judge.take(stream.key, found)
    progress(1.0)
    judge.finish()
    return judge.results()


def _reported(message: RecordedMessage) -> dict[str, TopicFigures]:
    """Return the figures of all streams in a diagnostic_msgs/DiagnosticArray of the recorder."""
    figures = {}
    array: Any = STORE.deserialize_cdr(message.cdr, message.ros_type)
    for status in array.status:
        facts = {pair.key: pair.value for pair in status.values}
        if {"topic", "direction", "measured_hz", "age_p99_seconds"} <= facts.keys():
            numbers = (facts["measured_hz"], facts["age_p99_seconds"])
            figures[facts["topic"]] = TopicFigures(*(float(n) if n else None for n in numbers))
    return figures
