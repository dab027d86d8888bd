# SPDX-License-Identifier: Apache-2.0
"""What was recorded and what comes again: equal, different, missing, new, left out, unfinished."""

from collections.abc import Iterator
from typing import Any

import pytest

from groundlink.core.clock import NANOS
from groundlink.messages.base import Imu
from groundlink.recording.comparison import (
    WAIT_NANOS,
    ComparedSpan,
    Comparison,
    FirstDifference,
    TopicComparison,
)
from groundlink.recording.reader import RecordedMessage
from groundlink.ros.cdr import to_cdr

TYPE = "sensor_msgs/msg/Imu"
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
STEP = NANOS // 100
ALL = ComparedSpan(0, 100 * NANOS, 0, 100 * NANOS)


def imu(nanos: int, x: float = 0.0) -> memoryview:
    message = Imu(nanos, "imu_link", UPRIGHT, (0.0, 0.0, 0.0), (x, 0.0, 0.0), 0.0, 0.0, 0.0)
    return to_cdr(message)


def samples(count: int, topic: str = "/imu", step: int = STEP) -> list[RecordedMessage]:
    return [RecordedMessage(i * step, topic, TYPE, bytes(imu(i * step))) for i in range(count)]


def compare(
    recorded: list[RecordedMessage],
    again: list[RecordedMessage],
    extent: ComparedSpan = ALL,
    left_out: Any = lambda topic, nanos: None,
) -> dict[str, TopicComparison]:
    comparison = Comparison(iter(recorded), extent, left_out)
    for message in again:
        comparison.take(message.topic, message.ros_type, message.nanos, memoryview(message.cdr))
    return {verdict.topic: verdict for verdict in comparison.verdicts()}


def in_time(*streams: list[RecordedMessage]) -> list[RecordedMessage]:
    return sorted((m for stream in streams for m in stream), key=lambda m: m.nanos)


def test_equal_in_whatever_order_topics_come() -> None:
    fast, slow = samples(500, "/fast"), samples(50, "/slow", 10 * STEP)
    again = [*fast[:120], *slow[:2], *fast[120:], *slow[2:]]
    found = compare(in_time(fast, slow), again)
    assert {v.topic: (v.recorded, v.equal, v.first) for v in found.values()} == {
        "/fast": (500, 500, None),
        "/slow": (50, 50, None),
    }


def test_the_first_difference_has_its_time_number_and_field() -> None:
    recorded = samples(100)
    again = list(recorded)
    for i in (40, 60):
        again[i] = recorded[i]._replace(cdr=bytes(imu(i * STEP, 0.5)))
    v = compare(recorded, again)["/imu"]
    assert (v.equal, v.different, v.missing, v.new) == (98, 2, 0, 0)
    assert v.first == FirstDifference(
        40 * STEP, 41, "linear_acceleration.x: 0.0 recorded, 0.5 repeated"
    )


def test_what_is_missing_does_not_shift_the_rest() -> None:
    recorded = samples(100)
    v = compare(recorded, recorded[:30] + recorded[33:])["/imu"]
    assert (v.equal, v.different, v.missing, v.new) == (97, 0, 3, 0)
    assert v.first == FirstDifference(30 * STEP, 31, "recorded, but missing in the repeated run")


def test_what_is_new_does_not_shift_the_rest() -> None:
    again = samples(100)
    v = compare(again[:30] + again[33:], again)["/imu"]
    assert (v.recorded, v.equal, v.different, v.missing, v.new) == (97, 97, 0, 0, 3)
    assert v.first == FirstDifference(
        30 * STEP, 31, "not recorded, but published in the repeated run"
    )


def test_what_was_left_out_for_a_cause_is_no_difference() -> None:
    again = samples(100)

    def left_out(topic: str, nanos: int) -> str | None:
        return "overloaded" if topic == "/imu" and 30 * STEP <= nanos <= 31 * STEP else None

    v = compare(again[:30] + again[32:], again, left_out=left_out)["/imu"]
    assert (v.equal, v.new, v.left_out, v.is_equal) == (98, 0, {"overloaded": 2}, True)
    v = compare(again[:30] + again[33:], again, left_out=left_out)["/imu"]
    assert (v.equal, v.new, v.left_out, v.is_equal) == (97, 1, {"overloaded": 2}, False)


def test_a_recording_that_was_ended_early_may_lack_its_last_messages() -> None:
    again, other = samples(100), samples(100, "/other")
    early = ComparedSpan(0, 100 * STEP, 0, 90 * STEP)
    found = compare(in_time(again[:95], other), in_time(again, other), early)
    assert (found["/imu"].ragged, found["/imu"].is_equal) == (5, True)
    holed = again[:92] + again[94:95]
    found = compare(in_time(holed, other), in_time(again, other), early)
    assert (found["/imu"].new, found["/imu"].ragged) == (2, 5)
    found = compare(in_time(again[:85], other), in_time(again, other), early)
    assert (found["/imu"].new, found["/imu"].ragged) == (5, 10)


def test_a_recording_of_a_run_under_way_may_lack_its_first_messages() -> None:
    again = samples(100)
    late = ComparedSpan(20 * STEP, 100 * STEP, 30 * STEP, 100 * STEP)
    v = compare(again[25:], again, late)["/imu"]
    assert (v.ragged, v.new, v.equal, v.is_equal) == (5, 0, 75, True)
    holed = again[22:25] + again[26:]
    v = compare(holed, again, late)["/imu"]
    assert (v.ragged, v.new, v.equal, v.is_equal) == (2, 1, 77, False)
    v = compare(again[40:], again, late)["/imu"]
    assert (v.ragged, v.new) == (10, 10)


def test_nothing_counts_before_the_recording_and_behind_its_end() -> None:
    again = samples(100)
    v = compare(again[20:], again, ComparedSpan(20 * STEP, 80 * STEP, 20 * STEP, 80 * STEP))["/imu"]
    assert (v.recorded, v.equal, v.is_equal) == (60, 60, True)


def test_a_topic_that_is_in_one_of_both_is_a_difference() -> None:
    recorded, again = samples(5, "/then"), samples(5, "/now")
    found = compare(recorded, again)
    assert (found["/then"].missing, found["/now"].new) == (5, 5)
    comparison = Comparison(iter(()), ALL, lambda topic, nanos: None)
    comparison.declare("/silent", TYPE, is_recorded=False)
    comparison.declare("/known", TYPE, is_recorded=True)
    (verdict,) = comparison.verdicts()
    assert (verdict.topic, verdict.is_equal) == ("/silent", False)


def test_memory_does_not_grow_with_a_topic_that_never_comes() -> None:
    step = NANOS
    taken: list[int] = []

    def read() -> Iterator[RecordedMessage]:
        for pair in zip(samples(100, "/gone", step), samples(100, "/imu", step), strict=True):
            yield from pair

    comparison = Comparison(
        read(), ComparedSpan(0, 1000 * NANOS, 0, 1000 * NANOS), lambda topic, nanos: None
    )
    for message in samples(100, "/imu", step):
        comparison.take("/imu", TYPE, message.nanos, memoryview(message.cdr))
        waiting = sum(len(topic._waiting) for topic in comparison._topics.values())
        taken.append(waiting)
    assert max(taken) <= WAIT_NANOS // step + 2
    found = {v.topic: v for v in comparison.verdicts()}
    assert (found["/gone"].missing, found["/imu"].equal) == (100, 100)


@pytest.mark.parametrize("size", [0, 1, 2_000_000])
def test_every_byte_counts(size: int) -> None:
    body = bytes(8) + bytes(size)
    again = body[:-1] + b"\1"
    recorded = [RecordedMessage(0, "/points", "sensor_msgs/msg/PointCloud2", body)]
    assert compare(recorded, recorded)["/points"].equal == 1
    changed = [RecordedMessage(0, "/points", "sensor_msgs/msg/PointCloud2", again)]
    first = compare(recorded, changed)["/points"].first
    assert first is not None
    assert f"byte {7 + size} of {8 + size}: 0 recorded, 1 repeated" in first.words
