# SPDX-License-Identifier: Apache-2.0
"""`groundlink sensors` tells what there is, from the files alone."""

from pathlib import Path

import pytest

from groundlink.__main__ import main
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.loader.scenario_files import SHIPPED

SHEETS = sorted((SHIPPED / "sensors").glob("*.yaml"))

MINE = """\
kind: range
datasheet: a ranger of mine
radiation: infrared
field_of_view_deg: 3
# A guess.
max_range_m: 2.5
"""


def said(capsys: pytest.CaptureFixture[str], *command: str, code: int = 0) -> str:
    assert main(["sensors", *command]) == code
    output = capsys.readouterr()
    return output.err if code else output.out


def test_every_kind_and_every_sheet_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    lines = said(capsys).splitlines()
    kind, found = "", {}
    for line in lines:
        if line and not line.startswith(" "):
            kind = line.partition(",")[0]
        elif line.startswith("  ") and line[2] != " ":
            found[line.split()[0]] = kind
    assert sorted(found) == [file.stem for file in SHEETS]
    assert {topic.name for topic in SENSOR_TOPICS.values()} <= {
        line.partition(",")[0] for line in lines
    }
    assert found["vlp16"] == "lidar"
    assert found["imu_mti1"] == "imu"
    text = " ".join("\n".join(lines).split())
    assert "Velodyne VLP-16 (Puck), User Manual 63-9243" in text
    assert "rotation_rate_hz 10.0, firings_per_revolution 1808, 16 elevations_deg" in text
    assert "PointCloud2: A spinning 3D LiDAR." in text


@pytest.mark.parametrize("file", SHEETS, ids=lambda file: file.stem)
def test_sheet_is_shown_completely(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = file.read_text(encoding="utf-8")
    shown = said(capsys, "show", file.stem)
    assert text.strip() in shown
    assert str(file) in shown
    assert "datasheet:" in text, "a shipped sheet names its source"


def test_fields_missing_from_a_sheet_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    shown = " ".join(said(capsys, "show", "hc_sr04").split())
    assert "Defaults of parameters that the sheet does not set: rays 128, echo nearest," in shown
    assert "range_stddev_m 0.0" not in shown, "which the sheet states"
    assert "None" not in said(capsys, "show", "vlp16"), "which is no word of a data sheet"
    assert "topic" not in shown.partition("Defaults of")[2], "which is the scenario's"


def test_a_file_of_ones_own_is_found_by_its_path_and_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sensors").mkdir()
    file = tmp_path / "sensors" / "mine.yaml"
    file.write_text(MINE, encoding="utf-8")
    assert "# A guess." in said(capsys, "show", str(file))
    monkeypatch.chdir(tmp_path)
    for name in ("mine", "sensors/mine.yaml"):
        assert "# A guess." in said(capsys, "show", name)


def test_a_list_that_is_piped_away_has_lines_that_fit(capsys: pytest.CaptureFixture[str]) -> None:
    assert max(map(len, said(capsys).splitlines()[:-1])) <= 110


MISTAKES = [
    ("max_range_m: 2.5", "max_rang_m: 2.5", 6, ["unknown key `max_rang_m`", "`max_range_m`?"]),
    ("max_range_m: 2.5", "max_range_m: -1", 6, ["`max_range_m`", "> 0", "-1"]),
    ("max_range_m: 2.5", "max_range_m: far", 6, ["`max_range_m`", "float", "'far'"]),
    ("kind: range", "kind: rang", 1, ["unknown kind `rang`", "did you mean `range`?"]),
    ("kind: range\n", "", 1, ["not a data sheet; expected a mapping with `kind`"]),
    (
        "radiation: infrared",
        "radiation: sound",
        3,
        ["`radiation`: unknown value `sound`", "`ultrasound`?"],
    ),
    ("# A guess.", "min_range_m: 9", 1, ["`min_range_m` is 9; expected less than `max_range_m`"]),
    ("# A guess.", "mount: {xyz: [0, 0, 1]}", 5, ["unknown key `mount.xyz`", "`xyz_m`?"]),
    ("# A guess.", "kind: range", 5, ["`kind`: duplicate key"]),
    ("# A guess.", "- [", 5, ["not valid YAML"]),
]


@pytest.mark.parametrize(("right", "wrong", "line", "words"), MISTAKES)
def test_a_mistake_in_a_sheet_is_one_line(
    right: str,
    wrong: str,
    line: int,
    words: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert MINE.count(right) == 1
    file = tmp_path / "mine.yaml"
    file.write_text(MINE.replace(right, wrong), encoding="utf-8")
    error = said(capsys, "show", str(file), code=2)
    assert error.count("\n") == 1
    assert error.startswith(f"groundlink: {file}:{line}: ")
    for word in words:
        assert word in error


def test_a_sheet_may_leave_what_is_needed_to_the_scenario(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(MINE.replace("field_of_view_deg: 3\n", ""), encoding="utf-8")
    assert "a ranger of mine" in said(capsys, "show", str(file))


@pytest.mark.parametrize("wrong", ["vlp61", "sensors/vlp61.yaml"])
def test_an_unknown_sheet_is_answered_with_the_nearest(
    wrong: str, capsys: pytest.CaptureFixture[str]
) -> None:
    error = said(capsys, "show", wrong, code=2)
    assert error.count("\n") == 1
    assert "did you mean `vlp16`?" in error


def test_missing_file_is_named_as_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "none.yaml"
    error = said(capsys, "show", str(file), code=2)
    assert error == f"groundlink: `{file}`: no such file\n"
