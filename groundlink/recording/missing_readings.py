# SPDX-License-Identifier: Apache-2.0
"""Missing readings of a recorded run, with the causes that its sensors reported."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator

from groundlink.messages.base import M
from groundlink.messages.missing_readings import Cause, Gaps
from groundlink.ros.cdr import from_cdr
from groundlink.ros.codec import Moment
from groundlink.ros.streams import CLOCK_TOPIC, gaps_topic
from groundlink.scenario.sensors import Encoders, WheelOdometry

from .reader import Recording

RECORDER_BEHIND = "recorder behind"
"""The cause of what came faster than it could be written."""

_STATES_MISSED: tuple[Cause, ...] = ("not there", "restarted", "states lost", "overloaded")
"""Causes for which a sensor's process did not see all states."""

LeftOut = Callable[[str, int], str | None]
"""Says why a topic has no message of an instant; None for no reason."""


def left_out(recording: Recording) -> LeftOut:
    """Return what knows which messages were missing when the recording was made.

    Of those that a recorder was too slow for it only knows how many they were, and counts.
    """
    scenario = recording.run.scenario
    behind = Counter(recording.dropped)
    found: dict[str, list[tuple[int, int, str]]] = defaultdict(list)
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            topics = sensor.ros_topics()
            for told in messages_of(recording, gaps_topic(f"{vehicle.name}/{sensor.name}"), Gaps):
                for gap in told.gaps:
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
    """Return the topics that need not come again with the same bytes, with the reason of each.

    What adds up from reading to reading begins at the first state that its process saw, and goes
    over those that it did not see in one step. Then it saw others than a process that sees all.
    """
    found: dict[str, str] = {}
    run, clock = recording.run, recording.topics.get(CLOCK_TOPIC)
    is_late = run.scenario.time.mode == "realtime" and clock and clock.first_nanos > run.epoch_nanos
    for vehicle in run.scenario.vehicles:
        for sensor in vehicle.sensors:
            misses = isinstance(sensor, Encoders) and sensor.missed_ticks > 0
            if not (misses or isinstance(sensor, WheelOdometry)):
                continue
            told = messages_of(recording, gaps_topic(f"{vehicle.name}/{sensor.name}"), Gaps)
            missed = Counter(gap.cause for news in told for gap in news.gaps)
            causes: list[str] = ["before the recording, perhaps"] if is_late else []
            causes += [cause for cause in _STATES_MISSED if missed[cause]]
            if causes:
                why = (
                    f"it adds up from the states that it saw, and missed some ({', '.join(causes)})"
                )
                found |= dict.fromkeys(sensor.ros_topics().values(), why)
    return found


def messages_of(recording: Recording, topic: str, message: type[M]) -> Iterator[M]:
    """Yield what was recorded of a topic whose recorded form can be read back."""
    for recorded in recording.read([topic]):
        yield from_cdr(recorded.cdr, message, Moment(recorded.nanos, recording.run.epoch_nanos))
