# SPDX-License-Identifier: Apache-2.0
"""`groundlink try`: a table, a page and an exit code for the trials of a vehicle."""

import json
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundlink.__main__ import main
from groundlink.report.analysis.trials import Trial, TrialCurve, TrialFigure, TrialPlot

CART = Path(__file__).parents[2] / "loader" / "urdf" / "cart.yaml"

PATH = TrialPlot("x, m", "y, m", (TrialCurve("true", (0.0, 1.0), (0.0, 0.0)),), equal=True)
SPEED = TrialPlot(
    "time, s",
    "speed, m/s",
    (TrialCurve("true", (0.0, 1.0), (0.5, 0.5)), TrialCurve("commanded", (0.0, 1.0), (1.0, 1.0))),
)
GOOD = Trial(
    "stand", "stand <still>", (TrialFigure("moved", 0.1, "mm", "at most 1", True),), (PATH,), "a"
)
BAD = Trial(
    "climb", "climb", (TrialFigure("height", 0.5, "m", "at least 2", False),), (SPEED,), "push"
)


@pytest.fixture
def _made_up(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """The process of the trials answers with these."""

    def run(command: list[str], **options: Any) -> subprocess.CompletedProcess[bytes]:
        assert command[1:4] == ["-m", "services.physics.trials", "my.yaml"]
        return subprocess.CompletedProcess(command, 0, msgspec.json.encode(request.param))

    monkeypatch.setattr(subprocess, "run", run)


@pytest.mark.parametrize(
    ("_made_up", "code"), [([GOOD], 0), ([GOOD, BAD], 1)], indirect=["_made_up"]
)
@pytest.mark.usefixtures("_made_up")
def test_table_page_and_exit_code(
    code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "my.html"
    assert main(["try", "my.yaml", "--out", str(out)]) == code
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines())) <= 110
    assert "0.1 mm" in said
    assert ("failed: climb: height not as expected. Fix: push" in said) is bool(code)
    page = out.read_text(encoding="utf-8")
    HTMLParser().feed(page)
    assert "Stand &lt;still&gt;" in page
    assert page.count("<svg") == 1 + code
    assert ("<tr class=bad>" in page) is bool(code)


@pytest.mark.parametrize("_made_up", [[GOOD, BAD]], indirect=True)
@pytest.mark.usefixtures("_made_up")
def test_json_has_figures_without_curves(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["try", "my.yaml", "--json"]) == 1
    good, bad = json.loads(capsys.readouterr().out)
    assert (good["good"], bad["good"]) == (True, False)
    assert bad["figures"][0]["value"] == 0.5
    assert "plots" not in good


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nothing"], "no world, vehicle or scenario `nothing` is shipped"),
        (["indoor_lab"], "is a scenario. Fix: pass a vehicle"),
        (["rover", "--out", "/nowhere/page.html"], "no such folder: /nowhere"),
    ],
)
def test_mistakes_are_one_line(
    words: list[str], said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["try", *words]) == 2
    error = capfd.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_urdf_is_tried(capfd: pytest.CaptureFixture[str]) -> None:
    """It rears up on a steep slope, since its only caster is in front."""
    assert main(["try", str(CART), "--json"]) == 1
    trials = {trial["name"]: trial for trial in json.loads(capfd.readouterr().out)}
    assert list(trials) == ["stand", "straight", "turn", "stop", "climb", "lean"]
    assert trials["turn"]["good"]
    assert not trials["climb"]["good"]
