# SPDX-License-Identifier: Apache-2.0
"""The page holds all figures, needs no network, and trusts nothing that it shows."""

import dataclasses
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.__main__ import main
from groundlink.report.analysis.diagnostics import (
    FaultPeriod,
    RunDiagnostics,
    SensorFaultHistory,
    StreamHistory,
)
from groundlink.report.analysis.energy import Energy
from groundlink.report.analysis.gather import RunSummary
from groundlink.report.analysis.motion import VehicleMotion
from groundlink.report.page.html import Markup, section, table, text
from groundlink.report.page.page import page
from groundlink.scenario.faults import Off, Stuck
from tests.groundlink.report.conftest import gathered_from, write

VOID = {"meta", "img", "br", "path", "use"}


class Reader(HTMLParser):
    """Checks that tags close in order; keeps addresses, headings and counts of tags."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.tags: dict[str, int] = {}
        self.headings: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] = self.tags.get(tag, 0) + 1
        self.addresses += [v or "" for n, v in attrs if n in ("src", "href", "xlink:href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def read(content: str) -> Reader:
    reader = Reader()
    reader.feed(content)
    reader.close()
    assert reader.open == []
    return reader


@pytest.fixture(scope="module")
def content(gathered: RunSummary) -> str:
    return page(gathered)


def test_everything_has_its_section(content: str) -> None:
    reader = read(content)
    assert ", ".join(reader.headings) == (
        "Expectations, Mission, Trajectory, Speed, Energy and contacts, Sensors, Rates and gaps, "
        "Ages and losses, "
        "Cameras, Missing readings, Processes, Provenance"
    )
    assert reader.tags["svg"] == 6
    assert reader.tags["img"] == 12


def test_page_needs_no_network(content: str) -> None:
    for address in read(content).addresses:
        assert address.startswith(("data:image/", "#")), address
    assert "@import" not in content
    assert not re.search(r"url\((?!#)", content)
    assert "<script" not in content


def test_shown_text_is_escaped(content: str) -> None:
    assert "&lt;script&gt;alert(&#x27;&amp;&#x27;)&lt;/script&gt;" in content


def test_figures_are_on_it(content: str) -> None:
    for words in (
        *("4.5 m</b><span>driven", "0.75 m/s", "295.0 J", "table_3_leg_1", "900 N at 3.2"),
        *("3 missing, 2 dropped", "9.0 ms", "lab-pc", "stale 4", "seed 1", "indoor_lab_tour"),
        *("never_touches: touched `table_3_leg_1` at 3.00 s", "touched nothing"),
        *("/imu: 1 gap, the longest of 500 ms", "rover touched table_3_leg_1"),
        *("/imu: of 2398 readings 150 overloaded, 49 unexplained", "2.0025 s", "2.3750 s"),
        "dropped because the sensor was behind",
        *("/imu: 3 of 2010 lost to ROS", "2023-11-14 22:13:20 UTC"),
    ):
        assert words in content, words


def test_unreported_streams_are_marked(gathered: RunSummary) -> None:
    ((key, words),) = gathered.diagnostics.streams.items()
    unknown = words.last | {"reported": "False", "lost": "0", "messages": "0", "missing": "0"}
    unknown |= {"dropped": "0", "sent": "2010"}
    diagnostics = RunDiagnostics()
    diagnostics.streams[key] = StreamHistory(unknown)
    cells = re.findall(
        r"<td[^>]*>(.*?)</td>", page(dataclasses.replace(gathered, diagnostics=diagnostics))
    )
    at = cells.index("2010")
    assert cells[at : at + 4] == ["2010", "", "", "not reported"]


def test_pictures_are_drawn_in_the_pages_own_colors(content: str) -> None:
    """No stand-in is left, and every variable that is used is one of the style sheet's."""
    used = set(re.findall(r"var\(--([a-z]+)\)", content))
    declared = set(re.findall(r"--([a-z]+):", content))
    assert used <= declared
    assert {"ink", "wall", "blue", "green", "red", "orange"} <= used
    assert not re.search(r"#0[0-9a-f]0[0-9a-f]0[0-9a-f]", content)


def test_the_same_run_is_the_same_page(recording: Path, content: str) -> None:
    assert page(gathered_from(recording)) == content


def test_absent_sections_are_omitted(gathered: RunSummary) -> None:
    bare = dataclasses.replace(
        gathered,
        motions=[VehicleMotion("rover", 1)],
        energies=[Energy("rover", 1)],
        missions=[],
        expectations=[],
        readings={"rover": []},
        cameras=[],
        completeness=[],
        diagnostics=RunDiagnostics(),
        streams=gathered.streams[:0],
        run=replace(gathered.run, epoch_nanos=0),
    )
    content = page(bare)
    reader = read(content)
    assert reader.headings == ["Trajectory", "Ages and losses", "Provenance"]
    assert "has no ground truth" in content
    assert "No gateway reported" in content
    assert "stamps count from zero" in content


def test_html_is_made_once() -> None:
    assert text(text("a < b")) == "a &lt; b"
    assert text(Markup("<b>")) == "<b>"
    assert section("empty", "") == ""
    assert '<td class="n">1 &lt; 2</td>' in table(("a",), [("1 < 2",)], numbers=(0,))
    assert "<tr class=off>" in table(("a",), [("1",)], off=(0,))


def test_the_command_writes_beside_the_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path / "run.mcap")
    assert main(["report", str(file)]) == 0
    assert "wrote" in capsys.readouterr().out
    assert (tmp_path / "run.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert main(["report", str(file), "--out", str(tmp_path / "none" / "x.html")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_faults_have_a_section_where_there_were_some(gathered: RunSummary) -> None:
    assert "Faults" not in read(page(gathered)).headings
    failures = SensorFaultHistory("rover/imu")
    failures.all = [
        FaultPeriod(Stuck(at_s=1.5, for_s=1.0), 1.5, 2.5),
        FaultPeriod(Off(at_s=3.0), 3.0),
    ]
    content = page(dataclasses.replace(gathered, failures=[failures]))
    assert "Faults" in read(content).headings
    assert "rover/imu had injected faults: stuck, off" in content
    assert "1.5000 s" in content
    assert "the end of the recording" in content
