# SPDX-License-Identifier: Apache-2.0
"""Messages of the bus and reports of the gateway become verdicts."""

from typing import Any

import pytest

from groundlink.expectations.results import FAILED, PASSED, UNDECIDED
from groundlink.messages.base import Health, StreamReport, encode
from groundlink.monitor.expectation_monitor import ExpectationMonitor
from groundlink.monitor.run_monitor import RunMonitor
from tests.groundlink.expectations.conftest import Expecting, drive, expecting
from tests.groundlink.expectations.drives import driven

from .test_mission_monitor import StandInBus

__all__ = ["drive", "expecting"]

EXPECTED: list[dict[str, Any]] = [
    {"kind": "reaches", "place": [-2, -4], "by_s": 7},
    {"kind": "never_touches"},
    {"kind": "rate", "topic": "/odom", "at_least_hz": 49},
    {"kind": "age", "topic": "/odom", "at_most_ms": 60},
]


def reports(monitor: RunMonitor, rate_hz: float, age_s: float, *, reported: bool = True) -> None:
    odom = StreamReport("/odom", "Odometry", 50.0, rate_hz, 0.0, 300, 0, age_p99_seconds=age_s)
    silent = StreamReport("/odom", "Odometry", 50.0, None, None, 0, 0, reported=False)
    streams = (odom if reported else silent,)
    monitor.update(Health("gateway", 1, 0, {}, streams), 0.0)


def test_a_run_is_judged_while_it_runs(expecting: Expecting) -> None:
    expectations = ExpectationMonitor(expecting(*EXPECTED), "lab")
    monitor, bus = RunMonitor(), StandInBus()
    expectations.subscribe(bus)  # type: ignore[arg-type]
    for key, message in driven(8, touched=["hall"]):
        full = f"groundlink/lab/{key}"
        if full in bus.inboxes:
            message_type, inbox = bus.inboxes[full]
            inbox.put(full, encode(message), message_type)  # type: ignore[attr-defined]
    reports(monitor, 10.0, 0.01)
    expectations.update(monitor)
    reports(monitor, 50.0, 0.02)
    expectations.update(monitor)
    assert [one.verdict for one in expectations.results()] == [PASSED, FAILED, UNDECIDED, UNDECIDED]
    assert expectations.is_settled
    expectations.finish()
    assert [one.verdict for one in expectations.results()] == [PASSED, FAILED, PASSED, PASSED]
    assert [one.value for one in expectations.results()][2:] == [50.0, 20.0]


@pytest.mark.parametrize("has_gateway", [True, False])
def test_a_silent_ros_side_is_a_problem(expecting: Expecting, has_gateway: bool) -> None:
    expectations, monitor = ExpectationMonitor(expecting(*EXPECTED[2:]), "lab"), RunMonitor()
    if has_gateway:
        reports(monitor, 0.0, 0.0, reported=False)
    expectations.update(monitor)
    expectations.finish()
    assert all(one.is_problem for one in expectations.results())


def test_without_a_scenario_there_is_nothing_to_judge() -> None:
    expectations = ExpectationMonitor()
    expectations.update(RunMonitor())
    expectations.finish()
    assert not expectations.results()
    assert not expectations.is_settled
