# SPDX-License-Identifier: Apache-2.0
"""Tables of commands at 80 and 60 columns: no number is cut, and nothing is lost but columns."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from groundlink.__main__ import main
from groundlink.bus.topics import TOPICS
from groundlink.cli.run import record
from groundlink.monitor.run_monitor import RunMonitor
from groundlink.recording import reader as reading
from groundlink.recording.metadata import TopicFacts


class Recorded:
    """A recording of these topics."""

    def __init__(self, topics: dict[str, TopicFacts]) -> None:
        self.topics = topics

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
        record._verdict(console, out, RunMonitor(), [])
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
