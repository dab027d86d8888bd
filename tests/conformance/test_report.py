# SPDX-License-Identifier: Apache-2.0
"""The command, the page, JUnit XML and the pytest plugin say what the clauses say."""

import ast
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from sensor_conformance.__main__ import main
from sensor_conformance.checking import CheckReport, check_source
from sensor_conformance.clauses import TABLE
from sensor_conformance.clauses.clause import Verdict
from sensor_conformance.report.junit import junit
from sensor_conformance.report.page import page
from sensor_conformance.report.plot import (
    MOST_POINTS,
    count_plot,
    named_plot,
    plot,
    series_plot,
    steps_plot,
)
from sensor_conformance.report.svg import svg
from sensor_conformance.sources.memory import MemorySource
from sensor_conformance.sources.source import SourceTopic

from .clean import imu
from .test_sources import KIND, mcap_file, ros_1

ROOT = Path(__file__).resolve().parents[2]
KIT = ROOT / "conformance" / "src"
ALLOWED = {"PIL", "numpy", "pytest", "rclpy", "rosbags", "sensor_conformance"}


@pytest.fixture(scope="module")
def report() -> CheckReport:
    """A report with a finding, on a topic whose name has to be escaped."""
    messages = imu()[:300]
    for _, message in messages:
        message.linear_acceleration.z = 1.0
    return check_source(MemorySource({SourceTopic("/<imu>", KIND): messages}))


def test_report_has_findings(report: CheckReport) -> None:
    assert "imu.gravity" in {one.clause.id for one in report.findings}
    assert sum(report.counts().values()) == len(report.results)


def test_page_shows_findings_first_and_escapes(report: CheckReport) -> None:
    text = page(report)
    assert "<imu>" not in text
    assert "/&lt;imu&gt;" in text
    assert text.index("imu.gravity") < text.index("stamps.increasing")
    assert text.count("<svg") >= 3
    assert "<script" not in text
    assert "http" not in text
    for one in report.results:
        assert one.clause.id in text


def test_junit_has_a_case_for_each_result(report: CheckReport) -> None:
    (suite,) = ElementTree.fromstring(junit(report))
    counts = report.counts()
    assert int(suite.attrib["tests"]) == len(suite) == len(report.results)
    assert len(suite.findall("*/failure")) == counts[Verdict.FAILED]
    assert len(suite.findall("*/skipped")) == counts[Verdict.NOT_TESTED]
    assert suite[0].attrib["name"] == "/<imu>"


def test_picture_has_curve_limits_and_ends() -> None:
    x = np.arange(5000.0)
    drawn = plot("time, s", "a < b", ("first", x, x), ("second", x, x * np.nan), limits=(7.0,))
    assert len(drawn.curves[0].x) <= MOST_POINTS
    root = ElementTree.fromstring(svg(drawn))
    assert [one.tag for one in root].count("polyline") == 2
    assert len([one for one in root if one.attrib.get("class") == "limit"]) == 1
    texts = [one.text for one in root if one.tag == "text"]
    assert "a < b" in texts
    assert "0" in texts


def test_kinds_of_pictures() -> None:
    counted = count_plot("wrong", np.array([False, True, False, True]))
    assert counted.curves[0].y.tolist() == [0, 1, 1, 2]
    series = series_plot("bytes", np.array([9, 7]), limits=(8.0,))
    assert series.curves[0].y.tolist() == [9, 7]
    assert series.limits == (8.0,)
    stairs = steps_plot("rate", np.array([3, 1, 1, 2, 9, 8]), most=3)
    assert stairs.curves[0].y.tolist() == [2, 3, 8]


def test_named_numbers_stand_below_a_picture() -> None:
    drawn = named_plot("pixels", {"fx": 120.0, "<cx>": 80.0})
    root = ElementTree.fromstring(svg(drawn))
    texts = {one.text: float(one.attrib.get("x", 0)) for one in root if one.tag == "text"}
    assert texts["fx"] < texts["<cx>"]
    assert not {"0", "1"} & set(texts)


def test_picture_without_points_is_empty() -> None:
    assert svg(plot("x", "y", ("none", np.zeros(0), np.zeros(0)))) == ""


@pytest.mark.parametrize("write", [ros_1, mcap_file])
def test_command_writes_reports(
    write: Callable[[Path], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    html, xml = tmp_path / "report.html", tmp_path / "results.xml"
    assert main([str(write(tmp_path)), "--html", str(html), "--junit", str(xml), "-v"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("passed imu.gravity /imu: median 9.8") for line in lines)
    assert "0 failed" in lines[-1]
    assert html.read_text().startswith("<!doctype html>")
    assert ElementTree.parse(xml).getroot().tag == "testsuites"


def test_command_selects_clauses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = str(ros_1(tmp_path))
    assert main([bag, "--only", "imu.*", "--skip", "imu.finite@/imu", "-v"]) == 0
    named = {line.split()[1] for line in capsys.readouterr().out.splitlines()[:-1]}
    assert "imu.gravity" in named
    assert not any(name.startswith("stamps.") or name == "imu.finite" for name in named)


def test_command_lists_clauses(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--clauses"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert listed == [clause.id for clause in TABLE]


def test_command_without_a_bag_is_an_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "missing.mcap")]) == 2
    assert "missing.mcap" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([])


def test_plugin_collects_a_named_recording(tmp_path: Path) -> None:
    bag = mcap_file(tmp_path)
    command = [sys.executable, "-m", "pytest", "-p", "sensor_conformance.plugin", "-q", "-rf"]
    command += ["-p", "no:cacheprovider", "--conformance-skip", "stamps.*", bag.name]
    done = subprocess.run(
        command,
        cwd=bag.parent,
        env={"PYTHONPATH": str(KIT), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout
    assert " skipped" in done.stdout


def test_kit_knows_no_groundlink() -> None:
    imported = set()
    for file in KIT.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add((node.module or "").partition(".")[0])
    assert imported - set(sys.stdlib_module_names) == ALLOWED
