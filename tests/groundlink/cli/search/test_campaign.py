# SPDX-License-Identifier: Apache-2.0
"""A campaign checks each fault once, continues after an interruption, and shows a matrix."""

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from groundlink.__main__ import main as groundlink
from groundlink.cli.commands import parser
from groundlink.search.point_journal import PointOutcome

from .conftest import Evaluations


def blind(changes: dict[str, Any]) -> PointOutcome:
    """Fail without the IMU, and with a late LiDAR."""
    for field, (fault,) in changes.items():
        sensor, kind = field.split(".")[3], fault["kind"]
        if (sensor, kind) in (("imu", "off"), ("lidar", "delay")):
            return PointOutcome("failed", f"<i>lost</i> at {fault['at_s']} s")
    return PointOutcome("passed", "arrived")


def campaign(out: Path, *words: str) -> int:
    return groundlink(
        ["campaign", "indoor_lab_tour", "--check", "./check", "--out", str(out), *words]
    )


WORDS = ("--fault", "off", "--fault", "delay", "--phases", "1,5")


def test_matrix_of_verdicts(
    evaluations: Evaluations, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluations.model = blind
    assert campaign(tmp_path / "out", *WORDS, "--json") == 1
    cells = json.loads(capsys.readouterr().out)["cells"]
    assert len(cells) == 12
    failed = [cell["values"] for cell in cells if cell["outcome"]["verdict"] == "failed"]
    assert [(each["sensor"], each["fault"], each["begin s"]) for each in failed] == [
        ("rover/lidar", "delay", 1.0),
        ("rover/lidar", "delay", 5.0),
        ("rover/imu", "off", 1.0),
        ("rover/imu", "off", 5.0),
    ]
    assert evaluations.requests[0].changes == []
    assert all(request.only_check for request in evaluations.requests)
    assert not any(request.over_link for request in evaluations.requests)
    table = parquet.read_table(tmp_path / "out" / "points.parquet").to_pylist()
    assert [row["verdict"] for row in table] == [cell["outcome"]["verdict"] for cell in cells]

    page = (tmp_path / "out" / "campaign.html").read_text(encoding="utf-8")
    assert "<i>" not in page
    assert page.count('<b class="bad">failed</b>') == 4
    assert "2 of 10" in page, "kinds of faults of the LiDAR"
    (command,) = (line for line in page.splitlines() if line.startswith("<pre>groundlink record"))
    words = shlex.split(
        command.removeprefix("<pre>")
        .removesuffix("</pre>")
        .replace("&quot;", '"')
        .replace("&#x27;", "'")
    )
    parser().parse_args(words[1:])


def test_interrupted_campaign_continues(evaluations: Evaluations, tmp_path: Path) -> None:
    evaluations.model = blind
    evaluations.interrupt_at = 8
    assert campaign(tmp_path / "out", *WORDS, "--jobs", "2") == 130
    evaluations.interrupt_at = 0
    begun = evaluations.changes
    assert campaign(tmp_path / "out", *WORDS, "--jobs", "3") == 1
    resumed = evaluations.changes[len(begun) :]
    assert len(begun[:7]) + len(resumed) == 13
    assert len({str(each) for each in [*begun[:7], *resumed]}) == 13


def test_check_that_fails_without_a_fault_ends_the_campaign(
    evaluations: Evaluations, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluations.model = lambda changes: PointOutcome("failed", "-")
    assert campaign(tmp_path / "out") == 1
    assert len(evaluations.requests) == 1
    assert "fails without a change" in capsys.readouterr().out


LOSSY = "{to_ros: {loss: 0.1}, from_ros: {delay_ms: 5}}"


def lossy(changes: dict[str, Any]) -> PointOutcome:
    """Fail where both a sensor has a fault and datagrams are lost."""
    is_lossy = bool(changes["gateway.link"])
    return PointOutcome("failed" if is_lossy and len(changes) > 1 else "passed", "-")


def test_links_are_an_axis_of_the_matrix(
    evaluations: Evaluations, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    evaluations.model = lossy
    out = tmp_path / "out"
    words = ("--sensors", "rover/imu", "--fault", "off", "--fault", "none", "--json")
    assert campaign(out, *words, "--link", "none", "--link", LOSSY) == 1
    cells = json.loads(capsys.readouterr().out)["cells"]
    assert [
        (*(cell["values"][n] for n in ("sensor", "fault", "link")), cell["outcome"]["verdict"])
        for cell in cells
    ] == [
        (None, "none", LOSSY, "passed"),
        ("rover/imu", "off", "none", "passed"),
        ("rover/imu", "off", LOSSY, "failed"),
    ]
    assert all(request.over_link for request in evaluations.requests)
    assert evaluations.changes[0].keys() == {"gateway.link"}, "the scenario over a perfect link"
    rows = parquet.read_table(out / "points.parquet").to_pylist()
    assert [row["begin s"] for row in rows] == [None, 1.0, 1.0]
    page = (out / "campaign.html").read_text(encoding="utf-8")
    assert page.count('<b class="bad">failed</b>') == 1
    assert "1 of 9" in page, "impairments of a direction"
    assert "--over-link" in page
    assert "gateway.link=" in page
