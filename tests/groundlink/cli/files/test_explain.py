# SPDX-License-Identifier: Apache-2.0
"""`groundlink explain` says what a field means, in lines that a terminal can show."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from groundlink.__main__ import main
from groundlink.cli.files.explain import lines
from groundlink.loader.field_reference import FieldReference
from groundlink.loader.json_schema import json_schema

ROOT = Path(__file__).resolve().parents[4]


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["explain", *words]) == 0
    return capsys.readouterr().out


def test_a_field(capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "lidar.start_deg") == (
        "vehicles.sensors.lidar.start_deg\n"
        "  Azimuth of the first firing of a revolution: 0 ahead, 90 to the left (REP\n"
        "  103).\n"
        "  type     number\n"
        "  unit     deg\n"
        "  default  0.0\n"
        "  range    from -360 up to 360\n"
    )


def test_a_struct_is_a_table_of_its_fields(capsys: pytest.CaptureFixture[str]) -> None:
    text = said(capsys, "time").splitlines()
    assert text[0] == "time"
    assert "  factor         number; above 0; default 1.0" in text
    assert text[text.index("  factor         number; above 0; default 1.0") + 1] == (
        "                 Sim seconds per second of the wall clock, in realtime and"
    )


def test_a_choice_is_a_table_of_its_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    text = said(capsys, "vehicles.sensors")
    assert "  lidar           A spinning 3D LiDAR.\n" in text
    assert "  type     list of one of 11 kinds\n" in text


def test_no_line_is_longer_than_80_columns() -> None:
    reference = FieldReference(json_schema("scenario"))
    for section in reference.sections.values():
        table = list(lines(reference, section))
        assert max(map(len, table)) <= 80, section.path
        names = [line.split()[0] for line in table if line.startswith("  ") and line[2:3].strip()]
        assert names[-len(section.fields) :] == list(section.fields)
        for field in section.fields.values():
            assert max(map(len, lines(reference, field))) <= 80, field.path


def test_json_has_the_same_facts(capsys: pytest.CaptureFixture[str]) -> None:
    (fact,) = json.loads(said(capsys, "lidar.start_deg", "--json"))
    assert fact == {
        "path": "vehicles.sensors.lidar.start_deg",
        "type": "number",
        "unit": "deg",
        "default": "0.0",
        "range": "from -360 up to 360",
        "description": "Azimuth of the first firing of a revolution: 0 ahead, 90 to the left "
        "(REP 103).",
        "kinds": [],
        "structs": [],
    }
    (sensors,) = json.loads(said(capsys, "sensors", "--json"))
    assert "lidar" in sensors["kinds"]
    (lidar,) = [s for s in sensors["structs"] if s["path"] == "vehicles.sensors.lidar"]
    assert "vehicles.sensors.lidar.dropout" in [f["path"] for f in lidar["fields"]]


def test_a_wrong_name_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "lidar.dropuot"]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error == (
        "groundlink: `lidar.dropuot`: unknown field or kind `dropuot`; did you mean `dropout`?\n"
    )


def test_a_kind_of_another_package_is_explained(tmp_path: Path) -> None:
    example = ROOT / "examples" / "magnetometer_sensor"
    installed = tmp_path / "magnetometer_sensor-0.1.0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Name: magnetometer-sensor\nVersion: 0.1.0\n")
    (installed / "entry_points.txt").write_text(
        "[groundlink.sensors]\nmagnetometer = magnetometer_sensor:KIND\n"
    )

    def printed(*words: str) -> str:
        return subprocess.run(
            [sys.executable, "-m", "groundlink", *words],
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{example}"},
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    properties = json.loads(printed("schema", "scenario"))["$defs"]["Magnetometer"]["properties"]
    assert [name for name, node in properties.items() if not node.get("description")] == []
    assert "tesla" in properties["earth_field_t"]["description"]
    assert printed("explain", "magnetometer.noise_stddev_t") == (
        "vehicles.sensors.magnetometer.noise_stddev_t\n"
        "  White noise of each axis, 1 sigma.\n"
        "  type     number\n"
        "  unit     T\n"
        "  default  0.0\n"
        "  range    from 0\n"
    )
