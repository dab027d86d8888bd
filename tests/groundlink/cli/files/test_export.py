# SPDX-License-Identifier: Apache-2.0
"""`groundlink export`: what is printed, what is refused, and that no half folder is left."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from groundlink.__main__ import main
from groundlink.data import export as exporting

FILE = Path(__file__).parents[3] / "compatibility" / "every_kind.mcap"


def said(capsys: pytest.CaptureFixture[str], *words: str | Path, code: int = 0) -> str:
    assert main(["export", str(FILE), *map(str, words)]) == code
    output = capsys.readouterr()
    assert (output.out if code else output.err) == ""
    assert code == 0 or output.err.count("\n") == 1
    return output.err if code else output.out


def test_all_formats_are_written_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    text = said(capsys, "--out", out)
    for name in ("odom.tum", "odom/kitti/", "points/pcd/", "imu.csv", "imu.parquet"):
        assert f"│{name} " in text
        assert (out / name).exists()
    assert "depth_image_rect_raw/png/" in text
    assert "not exported: /faults/rover/lidar, /ground_truth/bodies, " in text
    assert "/vitals: text or lists of messages" in text
    assert [*tmp_path.iterdir()] == [out]


def test_the_options_choose(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    text = said(
        capsys,
        *("--out", out, "--tum", "--pcd", "--topic", "/points", "--topic", "/ground_truth/odom"),
        *("--frame", "imu_link", "--from", "0.1", "--to", "0.3"),
    )
    paths = sorted(file.relative_to(out).as_posix() for file in out.rglob("*.*"))
    clouds = [f"points/pcd/{name}" for name in ("000000.pcd", "000001.pcd", "times.txt")]
    assert paths == ["ground_truth_odom.tum", "ground_truth_odom_imu_link.tum", *clouds]
    assert "not exported" not in text


def test_what_was_written_is_json_for_scripts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, bag = tmp_path / "out", tmp_path / "run.bag"
    content = json.loads(said(capsys, "--out", out, "--tum", "--json"))
    assert content["path"] == str(out)
    files = {found["path"]: found["messages"] for found in content["files"]}
    assert files["odom.tum"] == len((out / "odom.tum").read_text().splitlines()) > 1
    assert content["left_out"]["/imu"] == "no chosen format fits the type"
    assert main(["convert", str(FILE), str(bag), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["bytes"] == bag.stat().st_size
    assert content["messages"] > 100


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ("--out full", "--out full: folder is not empty. Fix: delete it or choose another name"),
        ("--out full/file", "--out full/file: file exists. Fix: "),
        ("--out no/where", "--out no/where: no such folder: no"),
        ("--out new --topic /imo", "no topic `/imo`; expected one of "),
        ("--out new --tum --frame lidar_lnk", "no frame `lidar_lnk`; did you mean `lidar_link`?"),
        ("--out new --csv --frame lidar_link", "--frame: expected --tum or --kitti. Fix: "),
        (
            "--out new --png --topic /imu",
            "every_kind.mcap: nothing to export: /imu: no chosen format fits the type",
        ),
        ("--out new --csv --from 9", ": no messages in this span"),
    ],
)
def test_mistakes_leave_everything_as_it_was(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: str,
    problem: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine", encoding="utf-8")
    assert problem in said(capsys, *words.split(), code=2)
    files = sorted(file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*"))
    assert files == ["full", "full/file"]
    assert (tmp_path / "full" / "file").read_text(encoding="utf-8") == "mine"


def test_ctrl_c_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    written = []

    def interrupted(file: Path, *_: Any) -> None:
        file.write_bytes(b"half")
        written.append(file)
        raise KeyboardInterrupt

    monkeypatch.setattr(exporting, "write_pcd", interrupted)
    assert said(capsys, "--out", tmp_path / "out", code=130) == "groundlink: interrupted\n"
    assert len(written) == 1
    assert [*tmp_path.iterdir()] == []


def test_a_missing_package_is_named_and_the_others_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    missing = (
        "the Python package `pyarrow` is not installed. Fix: pip install 'groundlink[export]'\n"
    )
    out = tmp_path / "out"
    assert said(capsys, "--out", out, "--parquet", code=3) == f"groundlink: {missing}"
    assert not out.exists()
    assert f"no --parquet: {missing}" in said(capsys, "--out", out, "--topic", "/imu")
    assert [file.name for file in out.iterdir()] == ["imu.csv"]
