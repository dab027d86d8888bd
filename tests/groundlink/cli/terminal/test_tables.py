# SPDX-License-Identifier: Apache-2.0
"""Tables of commands at 80 and 60 columns: no number is cut, and nothing is lost but columns."""

import io
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from groundlink.__main__ import main
from groundlink.bus.topics import TOPICS
from groundlink.cli.files import verify
from groundlink.cli.run import record
from groundlink.cli.run.dashboard import missions_table
from groundlink.cli.run.top import picture
from groundlink.episode.mission import Mission
from groundlink.messages.base import Health, StreamReport
from groundlink.monitor.overview import Overview
from groundlink.monitor.run_monitor import RunMonitor
from groundlink.recording import reader as reading
from groundlink.recording.comparison import FirstDifference, TopicComparison
from groundlink.recording.metadata import TopicFacts


class Recorded:
    """A recording of these topics."""

    def __init__(self, topics: dict[str, TopicFacts]) -> None:
        self.topics = topics
        self.run = SimpleNamespace(scenario=SimpleNamespace(name="lab", expect=()))

    def __enter__(self) -> "Recorded":
        return self

    def __exit__(self, *error: object) -> None:
        pass


@pytest.mark.parametrize("width", [80, 60])
def test_what_was_recorded_keeps_its_numbers_and_leaves_out_what_never_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    def facts(messages: int, rate_hz: float | None) -> TopicFacts:
        return TopicFacts(
            type="diagnostic_msgs/msg/DiagnosticArray",
            messages=messages,
            first_nanos=0,
            last_nanos=round((messages - 1) * 1e9 / rate_hz) if rate_hz else 0,
            declared_hz=rate_hz,
        )

    topics = {
        "/front_left/camera/image_raw/compressed": facts(1_234_567, 400.0),
        "/faults/rover/camera": facts(0, None),
        "/gaps/rover/camera": facts(0, None),
        "/gaps/rover/lidar": facts(89, None),
        "/cmd_vel": facts(0, None),
    }
    monkeypatch.setattr(reading, "Recording", lambda out: Recorded(topics))
    out = tmp_path / "run.mcap"
    out.touch()
    console = Console(width=width, file=io.StringIO())
    with console.capture() as capture:
        options = Namespace(out=str(out), json=False, junit=None)
        record._verdict(console, options, RunMonitor(), [])
    cells = [cell.strip() for text in capture.get().splitlines() for cell in text.split("│")]
    for cell in ("1234567", "400.00 Hz", "89", "/cmd_vel", "/gaps/rover/lidar"):
        assert cell in cells
    assert not {"/faults/rover/camera", "/gaps/rover/camera"} & set(cells)
    assert "…" not in capture.get()


@pytest.mark.parametrize("width", [200, 80, 60])
def test_the_topics_of_the_bus_are_shown_whole(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], width: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    assert main(["topics"]) == 0
    out = capsys.readouterr().out
    cells = {cell.strip() for text in out.splitlines() for cell in text.split("│")}
    assert max(map(len, out.splitlines())) <= width
    for topic in TOPICS:
        assert {topic.name, topic.key, topic.message.__name__, topic.delivery.value} <= cells


def long_overview() -> Overview:
    overview = Overview("lab", {"physics": None, "front_left/stereo_camera": 400.0})
    counters = {"readings": 1_234_567, "bus_bytes": 987_654_321, "gap_overloaded": 4321}
    streams = (StreamReport("/front_left/camera/image_raw", "Image", 400.0, 399.25, 0.0123, 11, 3),)
    for name, more in {"front_left/stereo_camera": (), "gateway": streams}.items():
        overview.presence_changed(name, True)
        for second in (0, 10):
            tick, host = 400 * second, "a-workstation.lab.example"
            health = Health(name, 4_194_304, tick, counters, more, host)
            overview.update(health, float(second))
    return overview


VERIFIED = TopicComparison(
    topic="/front_left/camera/image_raw/compressed",
    type="sensor_msgs/msg/CompressedImage",
    recorded=1_234_567,
    equal=1_234_560,
    different=7,
    first=FirstDifference(nanos=123_456_789_012, number=1_234_561, words=""),
)
MISSION = Mission(
    vehicle="decontamination_robot",
    state="left the map",
    seconds=1234.5,
    route_share=0.123,
    driven_m=98765.4,
    commanded_m=99999.9,
    followed_m=98765.4,
    commanded_rad=12.0,
    turned_rad=11.0,
    stuck_seconds=1234.5,
    events=(),
)
TABLES = {
    "top": (picture(long_overview(), 10.0), ["399.25 Hz", "12.3 ms", "4321", "1234567"]),
    "verify": (verify._table([VERIFIED], 0), ["1234567", "1234560", "7", "123.456789 s"]),
    "missions": (missions_table([MISSION]), ["12 %", "98765.4 m", "99 %", "92 %"]),
}


@pytest.mark.parametrize("width", [80, 60])
@pytest.mark.parametrize("name", TABLES)
def test_figures_of_a_table_are_whole(name: str, width: int) -> None:
    table, figures = TABLES[name]
    console = Console(width=width, file=io.StringIO())
    with console.capture() as capture:
        console.print(table)
    text = capture.get()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    cells = [cell.strip() for line in text.splitlines() for cell in line.split("│")]
    for figure in figures:
        assert any(figure in cell for cell in cells), figure
