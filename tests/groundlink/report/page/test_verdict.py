# SPDX-License-Identifier: Apache-2.0
"""Nothing is said to be well where a bar of the page is not green."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from groundlink.core.clock import NANOS
from groundlink.episode.mission_tracker import MissionTracker
from groundlink.report.analysis.gather import RunSummary
from groundlink.report.analysis.streams import StreamTimes
from groundlink.report.page.html import text
from groundlink.report.page.page import page
from groundlink.report.page.verdict import problems, verdict

SECONDS = 10


def track(seconds: list[float], declared_hz: float = 10.0) -> StreamTimes:
    found = StreamTimes(
        "/imu", "sensor_msgs/msg/Imu", declared_hz, first_nanos=0, last_nanos=SECONDS * NANOS
    )
    for each in seconds:
        found.add(round(each * NANOS), 100)
    return found


def run_of(gathered: RunSummary, stream: StreamTimes) -> RunSummary:
    quiet: Any = SimpleNamespace(streams={})
    return replace(
        gathered,
        **{"streams": [stream], "first_nanos": gathered.run.epoch_nanos, "diagnostics": quiet},
        **{"completeness": [], "failures": [], "energies": [], "undecodable": 0},
        missions=[],
        expectations=[],
    )


def every(begin_s: float, end_s: float, hz: float = 10.0) -> list[float]:
    return [i / hz for i in range(round(begin_s * hz), round(end_s * hz))]


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (every(0, 8), "not 10 Hz from 8.0 to 10.0 s"),
        (every(2, 10), "not 10 Hz from 0.0 to 2.0 s"),
        (
            [*every(0, 5), *every(5, 6, 12.0), *every(6, 8), *every(8, 9, 8.0), *every(9, 10)],
            "not 10 Hz from 5.0 to 6.0 s, from 8.0 to 9.0 s",
        ),
    ],
    ids=["ends early", "begins late", "too many, too few"],
)
def test_what_is_not_green_is_told(gathered: RunSummary, seconds: list[float], words: str) -> None:
    stream = track(seconds)
    bins = stream.bins()
    assert bins is not None
    assert not bins.kept.all()
    run = run_of(gathered, stream)
    assert problems(run) == [f"/imu: {words}"]
    assert "without a gap" not in verdict(run)


def test_where_all_is_green_all_is_well(gathered: RunSummary) -> None:
    run = run_of(gathered, track(every(0, 10)))
    assert problems(run) == []
    assert "without a gap" in verdict(run)


def test_of_many_times_some_are_named(gathered: RunSummary) -> None:
    rates = (12.0, 10.0, 8.0, 10.0, 12.0, 10.0, 8.0, 10.0, 10.0, 10.0)
    seconds = [each for i, hz in enumerate(rates) for each in every(i, i + 1, hz)]
    (line,) = problems(run_of(gathered, track(seconds)))
    assert line.endswith("from 4.0 to 5.0 s and 1 more")


def test_an_expectation_that_did_not_pass_comes_first_and_makes_the_page_red(
    gathered: RunSummary,
) -> None:
    run = replace(run_of(gathered, track(every(0, 8))), expectations=gathered.expectations)
    assert problems(run)[0] == "never_touches: touched `table_3_leg_1` at 3.00 s"
    assert len(problems(run)) == 2
    assert "verdict failed" in verdict(run)


def test_a_rover_that_stands_still_for_17_of_20_seconds_gets_a_red_page(
    gathered: RunSummary,
) -> None:
    tracker = MissionTracker(gathered.run.scenario.vehicles[0], None)
    for tick in range(200):
        tracker.commanded(tick / 10, 0.5, 0.0)
        tracker.moved(tick / 10, (min(0.05 * tick, 1.5), 0.0, 0.2), (0.0, 0.0, 0.0, 1.0))
    run = replace(run_of(gathered, track(every(0, 10))), missions=[tracker.mission()])
    stuck, drove = problems(run)
    assert stuck.startswith("rover: stuck at x 1.")
    assert drove == "rover drove 1.5 of 9.9 m commanded"
    assert 'class="verdict failed"' in verdict(run)
    content = page(replace(gathered, missions=run.missions, expectations=[]))
    (row,) = re.findall("<tr class=bad>.*</tr>", content)
    assert "stuck" in row
    assert content.count(f"<p>{text(stuck)}</p>") == 1
