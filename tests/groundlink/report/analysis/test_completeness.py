# SPDX-License-Identifier: Apache-2.0
"""Sums of a recording: what was due is in it, or missing for a cause that somebody told."""

import pytest

from groundlink.core.clock import NANOS
from groundlink.messages.missing_readings import Cause, MissingReadings, MissingSpan
from groundlink.report.analysis.completeness import (
    IN_TRANSIT,
    RECORDER_BEHIND,
    UNEXPLAINED,
    StreamCompleteness,
)
from services.sensors.range.spec import RangeFinder

EPOCH = 1_700_000_000 * NANOS
PERIOD = NANOS // 10
SONAR = RangeFinder(
    *("sonar", "/sonar", "sonar_link"),
    rate_hz=10.0,
    radiation="ultrasound",
    field_of_view_deg=10.0,
    max_range_m=4.0,
)


def completeness(
    *published: int, first: int = 0, last: int = 99, reported: int = 90
) -> StreamCompleteness:
    """Return one of a recording from one reading to another, with these in it."""
    made = StreamCompleteness(
        *("rover/sonar", "", "/sonar", SONAR),
        first_nanos=first * PERIOD,
        last_nanos=last * PERIOD,
        reported_nanos=reported * PERIOD,
    )
    for reading in published:
        made.add(reading * PERIOD)
    return made


def gaps(*told: tuple[Cause, int, int], outputs: tuple[str, ...] = ("",)) -> MissingReadings:
    return MissingReadings(
        *(EPOCH, "rover/sonar"),
        tuple(
            MissingSpan(cause, EPOCH + a * PERIOD, EPOCH + b * PERIOD, b - a + 1, outputs)
            for cause, a, b in told
        ),
    )


def holes(made: StreamCompleteness) -> list[tuple[str, int, int, int]]:
    """Return them with the numbers of their readings."""
    assert made.due == made.published + made.missing().total()
    return [
        (hole.cause, hole.first_nanos // PERIOD, hole.last_nanos // PERIOD, hole.readings)
        for hole in made.holes()
    ]


def test_complete_recording_lacks_nothing() -> None:
    made = completeness(*range(100))
    assert (made.due, made.published, holes(made)) == (100, 100, [])


def test_each_gap_has_its_cause_wherever_it_is() -> None:
    made = completeness(*range(10, 40), *range(43, 99))
    made.add_report(gaps(("not there", 0, 9), ("overloaded", 40, 41)), EPOCH)
    made.add_report(gaps(("states lost", 42, 42)), EPOCH)
    assert holes(made) == [
        ("not there", 0, 9, 10),
        ("overloaded", 40, 41, 2),
        ("states lost", 42, 42, 1),
        (IN_TRANSIT, 99, 99, 1),
    ]
    assert (made.due, made.published) == (100, 86)


def test_what_nobody_told_is_seen() -> None:
    made = completeness(*range(20), *range(25, 60))
    assert holes(made) == [
        (UNEXPLAINED, 20, 24, 5),
        (UNEXPLAINED, 60, 89, 30),
        (IN_TRANSIT, 90, 99, 10),
    ]


def test_recorded_readings_count_as_published_despite_gaps() -> None:
    """A successor counts from its predecessor's last word, after which more may have gone out."""
    made = completeness(*range(50), *range(60, 100))
    made.add_report(gaps(("restarted", 45, 59)), EPOCH)
    made.add_report(gaps(("overloaded", 45, 59)), EPOCH)
    assert holes(made) == [("restarted", 50, 59, 10)]
    late = completeness(*range(60, 100))
    late.add_report(gaps(("restarted", 0, 59)), EPOCH)
    for reading in range(10):
        late.add(reading * PERIOD)
    assert holes(late) == [("restarted", 10, 59, 50)]


def test_other_streams_of_the_sensor_have_gaps_of_their_own() -> None:
    made = completeness(*range(5), *range(6, 100))
    made.add_report(gaps(("off", 5, 5), outputs=("truth",)), EPOCH)
    assert holes(made) == [(UNEXPLAINED, 5, 5, 1)]


@pytest.mark.parametrize(("dropped", "cause"), [(4, RECORDER_BEHIND), (3, UNEXPLAINED)])
def test_what_the_recorder_could_not_take_is_its_own_fault(dropped: int, cause: str) -> None:
    made = completeness(*range(30), *range(34, 100))
    made.dropped(dropped)
    assert holes(made) == [(cause, 30, 33, 4)]


def test_a_recording_of_a_part_has_the_sums_of_this_part() -> None:
    made = completeness(*range(45, 60), first=40, last=59, reported=59)
    made.add_report(gaps(("overloaded", 30, 44)), EPOCH)
    assert (made.due, made.published) == (20, 15)
    assert holes(made) == [("overloaded", 40, 44, 5)]
