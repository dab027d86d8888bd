# SPDX-License-Identifier: Apache-2.0
"""Each kind of expectation passes, fails at its instant, or stays undecided; runs are made up."""

from collections.abc import Callable
from math import pi, radians
from typing import Any, NamedTuple

import pytest

from groundlink.core.frames import quaternion_from_rpy
from groundlink.expectations.planar import PlanarPose, planar
from groundlink.expectations.results import FAILED, PASSED, UNDECIDED, ExpectationResult
from groundlink.expectations.trackers import ExpectationTracker, TopicFigures, tracker

from .conftest import Expecting


class Feed(NamedTuple):
    """A run up to a sim time."""

    end_s: float
    calls: Callable[[ExpectationTracker], None]


def drives(seconds: float, *, speed: float = 1.0, y_m: float = -4.0) -> Feed:
    """Let the base drive east from the rover's start, with 50 poses per second."""

    def feed(one: ExpectationTracker) -> None:
        for number in range(round(50 * seconds) + 1):
            position = (-8.0 + speed * number / 50, y_m, 0.2)
            turn = quaternion_from_rpy(0.0, 0.0, 0.0)
            one.moved(planar(number / 50, position, turn))
            one.posed(number / 50, position, turn)

    return Feed(seconds, feed)


def touches(*contacts: tuple[float, str]) -> Feed:
    def feed(one: ExpectationTracker) -> None:
        for seconds, name in contacts:
            one.touched(seconds, [name] if name else [])

    return Feed(contacts[-1][0], feed)


def estimates(*errors: tuple[float, float, float]) -> Feed:
    """Estimate poses with errors: time (s), x (m), heading (deg)."""

    def feed(one: ExpectationTracker) -> None:
        for seconds, x_m, deg in errors:
            truth = PlanarPose(seconds, seconds, 1.0, pi - 0.01)
            one.estimated(PlanarPose(seconds, seconds + x_m, 1.0, radians(deg) - pi - 0.01), truth)

    return Feed(errors[-1][0], feed)


def measures(*figures: tuple[float, float | None, float | None]) -> Feed:
    """Report figures of a topic: time (s), rate (Hz), age (s)."""

    def feed(one: ExpectationTracker) -> None:
        for seconds, rate_hz, age_s in figures:
            one.measured(seconds, TopicFigures(rate_hz, age_s))

    return Feed(figures[-1][0], feed)


def stands_still(one: ExpectationTracker) -> None:
    """Command motion for 6 s to a rover at a wall that does not move."""
    for number in range(61):
        one.commanded(number / 10, 0.5, 0.0)
        one.touched(number / 10, ["wall"])
        one.posed(number / 10, (-8.0, -4.0, 0.2), (0.0, 0.0, 0.0, 1.0))


STUCK = Feed(6.0, stands_still)


def judged(
    expecting: Expecting, fields: dict[str, Any], *feeds: Feed
) -> tuple[str, ExpectationResult]:
    """Return the verdict before the end of a run, and the result at its end."""
    scenario = expecting(fields)
    one = tracker(scenario.expect[0], scenario, scenario.vehicles[0])
    for feed in feeds:
        feed.calls(one)
    early = one.verdict
    one.finish(feeds[-1].end_s)
    return early, one.result()


CORNER = {"kind": "reaches", "place": [-2.0, -4.0], "within_m": 0.3}
AREA = {"kind": "stays_within", "polygon_m": [[-9, -5], [0, -5], [0, -3], [-9, -3]]}
TOUCH = {"kind": "never_touches"}
POSITION = {"kind": "position_error", "topic": "/odom", "at_most_m": 0.1}
HEADING = {"kind": "heading_error", "topic": "/odom", "at_most_deg": 5}
AGE = {"kind": "age", "topic": "/odom", "at_most_ms": 60}
RATE = {"kind": "rate", "topic": "/odom", "at_least_hz": 49}

CASES = [
    # A place, with and without a time.
    (CORNER, drives(7), (PASSED, PASSED, 0.3, 5.7, "came within 0.30 m of x -2, y -4 m at 5.70 s")),
    (CORNER, drives(3), (UNDECIDED, FAILED, 3.0, 3.0, "by the end of the run")),
    (CORNER | {"by_s": 5}, drives(7), (FAILED, FAILED, 1.0, 5.0, "expected 0.3 m by 5 s")),
    (CORNER | {"by_s": 5.7}, drives(7), (PASSED, PASSED, 0.3, 5.7, "came within")),
    (CORNER | {"by_s": 9}, drives(3), (UNDECIDED, UNDECIDED, 3.0, 3.0, "before 9 s")),
    (CORNER | {"by_s": 3.09}, drives(3), (UNDECIDED, FAILED, 3.0, 3.0, "by 3.09 s")),
    (CORNER, drives(7, y_m=0), (UNDECIDED, FAILED, 4.0, 6.0, "came within 4.00 m")),
    (CORNER, touches((0, "")), (UNDECIDED, UNDECIDED, None, None, "no true pose")),
    # A route of 9 m, of which 6 m are driven.
    ({"kind": "completes_route", "at_least_share": 0.5}, drives(7), (PASSED, PASSED, 50, 4.52, "")),
    ({"kind": "completes_route"}, drives(6), (UNDECIDED, FAILED, 66.7, 6.0, "expected 98 %")),
    # An area, and the route.
    (AREA, drives(5), (UNDECIDED, PASSED, -1.0, 0.0, "at least 1 m inside")),
    (AREA, drives(9), (FAILED, FAILED, 0.02, 8.02, "left the area at x 0.02, y -4.00 m at 8.02 s")),
    (AREA | {"until_s": 8}, drives(9), (PASSED, PASSED, 0.0, 8.0, "inside")),
    (AREA | {"until_s": 8}, drives(7), (UNDECIDED, UNDECIDED, -1, 0, "ended at 7.0 s, before 8 s")),
    (AREA | {"from_s": 8}, drives(7), (UNDECIDED, UNDECIDED, None, None, "before 8 s")),
    (AREA | {"from_s": 8.5}, drives(9), (FAILED, FAILED, 0.5, 8.5, "left the area")),
    (
        {"kind": "stays_on_route", "within_m": 0.5},
        drives(9),
        (FAILED, FAILED, 0.52, 6.52, "0.52 m from the route at 6.52 s; expected at most 0.5 m"),
    ),
    ({"kind": "stays_on_route", "within_m": 0.5}, drives(6), (UNDECIDED, PASSED, 0, 0, "at most")),
    # Contacts.
    (TOUCH, touches((1, ""), (2, "")), (UNDECIDED, PASSED, 0, 1, "touched nothing")),
    (TOUCH, touches((1, ""), (2, "hall")), (FAILED, FAILED, 1, 2, "touched `hall` at 2.00 s")),
    (TOUCH | {"allowed": ["hall"]}, touches((2, "hall")), (UNDECIDED, PASSED, 0, 2, "nothing")),
    (TOUCH | {"until_s": 2}, touches((1, ""), (3, "hall")), (PASSED, PASSED, 0, 1, "nothing")),
    (TOUCH, drives(3), (UNDECIDED, UNDECIDED, None, None, "no report of contacts")),
    # Estimates: the first one is laid on the truth, or is a pose in the world.
    (POSITION, estimates((1, 0.5, 0), (2, 0.55, 0)), (UNDECIDED, PASSED, 0.05, 2, "at most 0.05")),
    (POSITION, estimates((1, 0.5, 0), (2, 0.7, 0)), (FAILED, FAILED, 0.2, 2, "0.2 m at 2.00 s")),
    (POSITION | {"origin": "world"}, estimates((1, 0.5, 0)), (FAILED, FAILED, 0.5, 1, "0.5 m")),
    (POSITION | {"from_s": 2}, estimates((1, 0.5, 0), (2, 0.5, 0)), (UNDECIDED, PASSED, 0, 2, "")),
    (POSITION, drives(3), (UNDECIDED, UNDECIDED, None, None, "no estimate of the pose")),
    (HEADING, estimates((1, 0, 3), (2, 0, 7)), (UNDECIDED, PASSED, 4, 2, "at most 4 deg")),
    (HEADING | {"origin": "world"}, estimates((2, 0, -7)), (FAILED, FAILED, 7, 2, "7 deg")),
    # Topics.
    (RATE, measures((1, 10, None), (2, 50, None)), (UNDECIDED, PASSED, 50, None, "50.00 Hz")),
    (RATE, measures((1, 50, None), (2, 10, None)), (UNDECIDED, FAILED, 10, None, "at least 49 Hz")),
    (RATE, measures((1, None, None)), (UNDECIDED, UNDECIDED, None, None, "fewer than two")),
    (AGE, measures((1, 50, 0.02), (2, 50, 0.05)), (UNDECIDED, PASSED, 50, 2, "at most 50 ms")),
    (AGE, measures((1, 50, 0.07), (2, 50, 0.05)), (FAILED, FAILED, 70, 1, "70 ms at 1.00 s")),
    (AGE | {"from_s": 2}, measures((1, 0, 0.07), (2, 0, 0.05)), (UNDECIDED, PASSED, 50, 2, "")),
    (AGE, measures((1, 50, None)), (UNDECIDED, UNDECIDED, None, None, "reported no ages")),
    # Failures.
    ({"kind": "never_fails"}, drives(3), (UNDECIDED, PASSED, 0, 0, "no failure")),
    ({"kind": "never_fails"}, STUCK, (FAILED, FAILED, 1, 0.1, "stuck at x -8.00, y -4.00 m since")),
    ({"kind": "never_fails", "allowed": ["stuck"]}, STUCK, (UNDECIDED, PASSED, 0, 0, "no failure")),
]


@pytest.mark.parametrize(("fields", "feed", "expected"), CASES)
def test_a_kind_of_expectation(
    expecting: Expecting, fields: dict[str, Any], feed: Feed, expected: tuple[Any, ...]
) -> None:
    early, result = judged(expecting, fields, feed)
    verdict_before_the_end, verdict, value, at_s, words = expected
    assert (early, result.verdict) == (verdict_before_the_end, verdict)
    assert result.value == (None if value is None else pytest.approx(value, abs=0.05))
    assert result.at_s == (None if at_s is None else pytest.approx(at_s, abs=0.1))
    assert words in result.text
    assert "\n" not in result.text


def test_a_decided_verdict_stays(expecting: Expecting) -> None:
    _, first = judged(expecting, CORNER, drives(7))
    _, second = judged(expecting, CORNER, drives(7), drives(3))
    assert first == second
