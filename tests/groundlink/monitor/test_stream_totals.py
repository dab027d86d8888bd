# SPDX-License-Identifier: Apache-2.0
import pytest
from msgspec.structs import replace

from groundlink.messages.base import Health, StreamReport
from groundlink.monitor.run_monitor import RunMonitor


def report(sent: int, *, lost: int = 0, hz: float | None = 100.0) -> StreamReport:
    arrived = sent - lost
    counts = {"sent": sent, "missing": lost, "delivered_bytes": 10 * arrived}
    return StreamReport("/clock", "Clock", 100.0, hz, 0.001, arrived, lost, **counts)


def heard(*healths: tuple[int, StreamReport]) -> StreamReport:
    """Return the total after gateways of these process ids have reported."""
    monitor = RunMonitor()
    for second, (pid, row) in enumerate(healths):
        monitor.update(Health("gateway", pid, 400 * second, {}, (row,)), float(second))
    [total] = monitor.streams
    return total


def test_one_gateway_counts_for_itself() -> None:
    assert heard((7, report(100)), (7, report(200))) == report(200)


@pytest.mark.parametrize("second", [50, 500], ids=["fewer than before", "more than before"])
def test_counts_of_a_restarted_gateway_are_added_to_those_before(second: int) -> None:
    total = heard((7, report(100)), (7, report(300, lost=3)), (8, report(10)), (8, report(second)))
    assert (total.sent, total.messages, total.missing) == (300 + second, 297 + second, 3)
    assert total.delivered_bytes == 10 * total.messages
    assert total.age_seconds == 0.001


def test_three_episodes_add_up() -> None:
    assert heard((7, report(100)), (8, report(200, lost=5)), (9, report(50))).sent == 350


def test_counters_that_restart_in_the_same_process_begin_an_episode() -> None:
    total = heard((7, report(300)), (7, report(20)), (7, report(40)))
    assert (total.sent, total.messages, total.delivered_bytes) == (340, 340, 3400)


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("now", [False, True])
def test_what_one_episode_was_told_of_is_reported(before: bool, now: bool) -> None:
    episodes = (replace(report(100), reported=told) for told in (before, now))
    assert heard(*enumerate(episodes)).reported is (before or now)


def test_the_rate_is_that_over_all_episodes() -> None:
    total = heard((7, report(101, hz=100.0)), (8, report(51, hz=50.0)))
    assert total.measured_hz == pytest.approx(150 / 2.0)
    assert heard((7, report(101)), (8, report(0, hz=None))).measured_hz == pytest.approx(100.0)
    assert heard((7, report(0, hz=None)), (8, report(0, hz=None))).measured_hz is None
