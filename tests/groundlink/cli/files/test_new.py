# SPDX-License-Identifier: Apache-2.0
"""`groundlink new` writes a scenario that is valid, runs, and is completed by editors."""

from pathlib import Path

import pytest
import yaml

from groundlink.__main__ import main
from groundlink.loader import load
from tests.groundlink.loader.test_json_schema import mistakes, named_schema
from tools import json_schemas


def test_a_new_scenario_is_valid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my_scenario"]) == 0
    file = Path("my_scenario.yaml")
    assert "groundlink up my_scenario.yaml" in capsys.readouterr().out
    warnings: list[str] = []
    scenario = load(file, warn=warnings.append)
    assert scenario.name == "my_scenario"
    assert scenario.vehicles[0].route
    assert len(scenario.vehicles[0].sensors) == 3
    assert warnings == []
    assert mistakes("scenario", yaml.safe_load(file.read_text())) == []
    assert named_schema(file) == json_schemas.FOLDER / "scenario.json"
    assert main(["check", "my_scenario.yaml"]) == 0
    assert "warning" not in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("My Scenario", "`My Scenario`: expected lower case letters"),
        ("nowhere/mine.yaml", "no such folder"),
        ("taken", "taken.yaml: file exists"),
    ],
)
def test_a_file_that_cannot_be_written_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    name: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.yaml").write_text("name: taken\n")
    assert main(["new", name]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert (tmp_path / "taken.yaml").read_text() == "name: taken\n"
