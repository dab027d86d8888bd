# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus become results, whatever order the streams come in."""

import random
from collections.abc import Sequence
from typing import Any

import pytest

from groundlink.core.clock import NANOS
from groundlink.expectations.judge import ExpectationJudge
from groundlink.expectations.results import FAILED, PASSED, UNDECIDED, ExpectationResult
from groundlink.expectations.trackers import TopicFigures

from .conftest import Expecting
from .drives import EPOCH, Sent, driven, vitals

CORNER: dict[str, Any] = {"kind": "reaches", "place": [-2, -4], "within_m": 0.3, "by_s": 7}
TOUCH: dict[str, Any] = {"kind": "never_touches"}
POSE = {"kind": "position_error", "topic": "/pose", "at_most_m": 0.1, "origin": "world"}
AGE = {"kind": "age", "topic": "/odom", "at_most_ms": 60}
RATE = {"kind": "rate", "topic": "/odom", "at_least_hz": 49}
FAILS = {"kind": "never_fails"}


def feed(judge: ExpectationJudge, sent: Sequence[Sent]) -> None:
    """Hand over the messages that are needed."""
    for key, message in sent:
        if f"groundlink/lab/{key}" in judge.streams:
            judge.take(f"groundlink/lab/{key}", message)


def results(judge: ExpectationJudge, sent: Sequence[Sent]) -> list[ExpectationResult]:
    feed(judge, sent)
    judge.finish()
    return judge.results()


def test_only_needed_streams_are_read(expecting: Expecting) -> None:
    def needed(*fields: dict[str, object]) -> list[str]:
        judge = ExpectationJudge(expecting(*fields), "lab")
        return sorted(key.removeprefix("groundlink/lab/rover/") for key in judge.streams)

    assert needed(CORNER) == ["ground_truth", "vitals"]
    assert needed(POSE) == ["from_ros/pose", "ground_truth", "vitals"]
    assert needed(FAILS) == ["command", "ground_truth", "vitals"]
    assert needed(RATE, AGE) == []


def test_a_drive_is_judged_in_the_order_of_the_scenario(expecting: Expecting) -> None:
    judge = ExpectationJudge(expecting(TOUCH, POSE, CORNER, FAILS), "lab")
    found = results(judge, driven(8, touched=["hall"]))
    assert [(one.kind, one.verdict) for one in found] == [
        ("never_touches", FAILED),
        ("position_error", PASSED),
        ("reaches", PASSED),
        ("never_fails", PASSED),
    ]
    assert found[0].at_s == 8.0
    assert found[2].at_s == pytest.approx(5.7)
    assert found[1].value == pytest.approx(0.05)


def test_streams_may_be_delayed_against_each_other(expecting: Expecting) -> None:
    scenario = expecting(TOUCH, POSE, CORNER)
    sent = driven(8, touched=["hall"])
    expected = results(ExpectationJudge(scenario, "lab"), sent)
    generator = random.Random(1)
    delays = {key: generator.uniform(0.0, 0.3) for key in {key for key, _ in sent}}
    late = sorted(sent, key=lambda one: one[1].stamp_nanos / NANOS + delays[one[0]])  # type: ignore[attr-defined]
    assert late != sent
    assert results(ExpectationJudge(scenario, "lab"), late) == expected


def test_messages_before_the_first_vitals_count(expecting: Expecting) -> None:
    scenario, sent = expecting(CORNER, TOUCH), driven(8, touched=["hall"])
    expected = results(ExpectationJudge(scenario, "lab"), sent)
    late = sorted(sent, key=lambda one: one[0] == "rover/vitals")
    assert results(ExpectationJudge(scenario, "lab"), late) == expected


def test_an_episode_is_judged_anew(expecting: Expecting) -> None:
    judge = ExpectationJudge(expecting(CORNER, TOUCH), "lab")
    second = EPOCH + 100 * NANOS
    found = results(judge, [*driven(7, touched=["hall"]), *driven(3, epoch=second)])
    assert [one.verdict for one in found] == [UNDECIDED, PASSED]


def test_an_episode_may_be_joined_later(expecting: Expecting) -> None:
    judge = ExpectationJudge(expecting(CORNER, TOUCH), "lab")
    second = EPOCH + 100 * NANOS
    joined = [one for one in driven(7, epoch=second) if one[1].stamp_nanos >= second + 2 * NANOS]  # type: ignore[attr-defined]
    found = results(judge, [*driven(1, touched=["hall"]), *joined])
    assert [one.verdict for one in found] == [PASSED, PASSED]


@pytest.mark.parametrize(
    ("fields", "sent", "is_settled"),
    [
        ((CORNER, TOUCH), driven(5), False),
        ((CORNER, TOUCH), driven(6), True),
        ((CORNER, TOUCH), [vitals(0, ["hall"])], True),
        ((TOUCH,), driven(6), False),
        ((CORNER, TOUCH | {"until_s": 8}), driven(6), False),
        ((CORNER, TOUCH | {"until_s": 8}), driven(9), True),
    ],
)
def test_a_verdict_is_settled_by_a_failure_or_by_all_that_can_pass_early(
    expecting: Expecting, fields: Sequence[dict[str, Any]], sent: list[Sent], is_settled: bool
) -> None:
    judge = ExpectationJudge(expecting(*fields), "lab")
    feed(judge, sent)
    assert judge.is_settled == is_settled


def test_what_is_not_in_the_world_stays_undecided(expecting: Expecting) -> None:
    scenario = expecting(TOUCH, {"kind": "reaches", "place": "goal"})
    touch, goal = results(ExpectationJudge(scenario, "lab"), driven(1))
    assert touch.verdict == PASSED
    assert (goal.verdict, goal.is_problem, goal.limit) == (UNDECIDED, True, None)
    assert goal.text.startswith("no pose or checkpoint `goal`")
    assert goal.cells[3] == "-"


def test_figures_of_topics(expecting: Expecting) -> None:
    recorded = ExpectationJudge(expecting(RATE, AGE), "lab")
    recorded.recorded({"/odom": TopicFigures(50.0), "/other": TopicFigures(1.0)})
    recorded.finish()
    rate, age = recorded.results()
    assert rate.verdict == PASSED
    assert (age.verdict, age.skipped, age.is_problem) == (UNDECIDED, True, False)

    live = ExpectationJudge(expecting(RATE, AGE), "lab")
    live.reported(0.0, {})
    live.finish()
    assert [(one.verdict, one.is_problem) for one in live.results()] == [(UNDECIDED, True)] * 2

    live = ExpectationJudge(expecting(RATE, AGE), "lab")
    live.reported(5.0, {"/odom": TopicFigures(50.0, 0.01)})
    live.reported(6.0, {"/odom": TopicFigures(50.0, 0.09)})
    live.finish()
    assert [one.verdict for one in live.results()] == [PASSED, FAILED]
    assert live.results()[1].at_s == 6.0
