# SPDX-License-Identifier: Apache-2.0
"""Missing readings of a recorded run, with the causes that its sensors reported."""

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator

from groundlink.messages.base import M
from groundlink.messages.missing_readings import Cause, MissingReadings
from groundlink.ros.cdr import from_cdr
from groundlink.ros.codec import Moment
from groundlink.ros.streams import CLOCK_TOPIC, missing_readings_topic

from .reader import Recording

RECORDER_BEHIND = "recorder behind"
"""Cause of messages dropped because the recorder could not keep up."""

_STATES_MISSED: tuple[Cause, ...] = ("not there", "restarted", "states lost", "overloaded")
"""Causes that imply missed states in the sensor's process."""

LeftOut = Callable[[str, int], str | None]
"""Returns why a topic has no message of an instant; None for no known cause."""


def left_out(recording: Recording) -> LeftOut:
    """Return a function that explains missing messages of a recording.

    For messages that the recorder dropped only their number is known; they are counted down.
    """
    scenario = recording.run.scenario
    behind = Counter(recording.dropped)
    found: dict[str, list[tuple[int, int, str]]] = defaultdict(list)
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            topics = sensor.ros_topics()
            for report in messages_of(
                recording, missing_readings_topic(f"{vehicle.name}/{sensor.name}"), MissingReadings
            ):
                for gap in report.gaps:
                    for output in gap.outputs:
                        found[topics[output]].append((gap.first_nanos, gap.last_nanos, gap.cause))
    for gaps in found.values():
        gaps.sort()

    def cause_of(topic: str, nanos: int) -> str | None:
        gaps = found.get(topic, [])
        at = bisect_right(gaps, nanos, key=lambda gap: gap[0]) - 1
        if at >= 0 and nanos <= gaps[at][1]:
            return gaps[at][2]
        behind[topic] -= 1
        return RECORDER_BEHIND if behind[topic] >= 0 else None

    return cause_of


def accumulating_topics(recording: Recording) -> dict[str, str]:
    """Return the topics that are not reproducible byte by byte, with the reason of each.

    Readings that accumulate depend on the states that the process received; a process that missed
    states accumulates differently.
    """
    found: dict[str, str] = {}
    run, clock = recording.run, recording.topics.get(CLOCK_TOPIC)
    is_late = run.scenario.time.mode == "realtime" and clock and clock.first_nanos > run.epoch_nanos
    for vehicle in run.scenario.vehicles:
        for sensor in vehicle.sensors:
            if not sensor.accumulates:
                continue
            reports = messages_of(
                recording, missing_readings_topic(f"{vehicle.name}/{sensor.name}"), MissingReadings
            )
            missed = Counter(gap.cause for news in reports for gap in news.gaps)
            causes: list[str] = ["before the recording, perhaps"] if is_late else []
            causes += [cause for cause in _STATES_MISSED if missed[cause]]
            if causes:
                why = (
                    f"it adds up from the states that it saw, and missed some ({', '.join(causes)})"
                )
                found |= dict.fromkeys(sensor.ros_topics().values(), why)
    return found


def messages_of(recording: Recording, topic: str, message: type[M]) -> Iterator[M]:
    """Yield the recorded messages of a topic as messages of the bus."""
    for recorded in recording.read([topic]):
        yield from_cdr(recorded.cdr, message, Moment(recorded.nanos, recording.run.epoch_nanos))
