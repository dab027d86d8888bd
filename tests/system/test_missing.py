# SPDX-License-Identifier: Apache-2.0
"""System tests of missing readings: under overload, each reading is recorded or has a cause.

LiDARs that exceed the speed of one core run in real time beside loops that keep all cores busy.
"""

import os
import time
from pathlib import Path
from typing import NamedTuple

import pytest

from groundlink.bus.core_topics import CLOCK
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import Clock
from groundlink.recording.reader import Recording
from groundlink.report.analysis.completeness import IN_TRANSIT, UNEXPLAINED, StreamCompleteness
from groundlink.report.analysis.gather import gather

from .rig import Rig, rig, wait_for

pytestmark = [pytest.mark.system, pytest.mark.alone]

HEAVY = ("heavy_1", "heavy_2")
SECONDS = {"skip": 6.0, "slow": 3.0}
FULL_PACE = 0.97
MOST_LATE_READINGS = 40
"""Readings of two seconds."""


def heavy_lidar(name: str) -> str:
    """Return one of 21 million rays a second and small clouds."""
    elevations = ", ".join(str(2 * laser - 16) for laser in range(16))
    return (
        f"      - {{kind: lidar, name: {name}, topic: /{name}, frame: {name}_link, mount: mast,"
        f" elevations_deg: [{elevations}], rotation_rate_hz: 20.0, firings_per_revolution: 1024,"
        " divergence_mrad: [3.0, 3.0], rays_per_beam: 64}\n"
    )


class Run(NamedTuple):
    """What became of a run."""

    factor: float
    """Sim seconds for each second of the wall's, from its first clock to its last."""

    streams: dict[str, StreamCompleteness]


def recorded(it: Rig, seconds: float) -> Run:
    """Record a run, with all cores busy, and return its streams by topic."""
    text = it.scenario.read_text(encoding="utf-8")
    sensors = "    sensors:\n"
    assert text.count(sensors) == 1
    heavy = "".join(map(heavy_lidar, HEAVY))
    it.scenario.write_text(text.replace(sensors, sensors + heavy), encoding="utf-8")
    file = it.folder / "run.mcap"
    for core in range(os.cpu_count() or 1):
        it.start("-c", "while True: pass", log=f"busy_{core}.log")
    record = it.start(
        *("-m", "groundlink", "record", str(it.scenario), "--out", str(file), "--realtime"),
        *("--duration", str(seconds), "--run", it.run, "--listen", it.endpoint),
        log="record.log",
    )
    wait_for(it.is_answered, 60, "the bus opens")
    times: list[tuple[float, int]] = []
    with Bus(connect=it.endpoint) as bus:
        clocks: BusInbox[Clock] = BusInbox(depth=16)
        bus.subscribe(CLOCK.key_in(it.run), Clock, clocks)
        while record.poll() is None:
            if arrived := clocks.get(seconds=0.1):
                times.append((time.monotonic(), arrived[1].tick))
                assert len(times) < 100 * 300, it.log("record.log")
    assert record.returncode in (0, 1), it.log("record.log")
    (begun, first), (ended, last) = times[0], times[-1]
    with Recording(file) as recording:
        found = gather(recording, lambda share: None)
    factor = (last - first) * 0.0025 / (ended - begun)
    return Run(factor, {stream.topic: stream for stream in found.completeness})


@pytest.fixture
def overloaded(request: pytest.FixtureRequest, tmp_path: Path) -> Run:
    overload: str = request.param
    with rig(tmp_path, time_section=f"time: {{overload: {overload}, deadline_s: 60}}\n") as it:
        return recorded(it, SECONDS[overload])


@pytest.mark.parametrize("overloaded", ["skip"], indirect=True)
def test_skip_keeps_the_pace_and_marks_all_that_it_leaves_out(overloaded: Run) -> None:
    assert overloaded.factor > FULL_PACE
    for topic, stream in overloaded.streams.items():
        missing = stream.missing()
        print(topic, stream.due, stream.published, dict(missing))
        assert stream.due == stream.published + missing.total()
        # A sensor reports after each revolution that it measures. One that is far behind may still
        # measure when the recording ends; the readings after its last report are then unexplained.
        late = [hole for hole in stream.holes() if hole.cause == UNEXPLAINED]
        if late and topic.removeprefix("/") in HEAVY:
            assert [hole.cause for hole in stream.holes()[-2:]] == [UNEXPLAINED, IN_TRANSIT], topic
            assert missing.pop(UNEXPLAINED) == late[-1].readings <= MOST_LATE_READINGS, topic
        assert missing.keys() <= {"overloaded", IN_TRANSIT}, topic
    for name in HEAVY:
        assert overloaded.streams[f"/{name}"].missing()["overloaded"] > 0
    assert overloaded.streams["/imu"].published > 0


@pytest.mark.parametrize("overloaded", ["slow"], indirect=True)
def test_slow_leaves_nothing_out_and_takes_longer(overloaded: Run) -> None:
    assert overloaded.factor < FULL_PACE
    for topic, stream in overloaded.streams.items():
        missing = stream.missing()
        print(topic, stream.due, stream.published, dict(missing))
        assert missing.keys() <= {IN_TRANSIT}, topic
        # What is under way is the reading, or the revolution, that had not ended.
        assert stream.due - stream.published <= 1, topic
