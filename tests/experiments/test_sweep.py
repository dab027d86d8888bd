# SPDX-License-Identifier: Apache-2.0
"""A sweep runs an experiment with each combination of what is varied, and no other."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from experiments.estimation.evaluation import Evaluation, read_csv
from experiments.experiment import Experiment, ExperimentOptions
from experiments.recording.setups import Setup
from experiments.studies import sweep as module
from groundlink.__main__ import main as groundlink
from groundlink.core.errors import UserError

MOUNTS = "scanner.mount=[lidar, {xyz_m: [0.2, 0.0, 0.9]}]"
SHEETS = "scanner.datasheet=[sensors/utm30lx.yaml, sensors/lms111.yaml]"
SETUP = Setup(name="swept", scenario="indoor_paper", seconds=1.0, sensors={"camera": None})


def result(options: ExperimentOptions) -> Evaluation:
    """A result whose error is told by the scanner that the run had."""
    (scanner,) = (
        sensor
        for sensor in SETUP.varied(options.vary).document()["vehicles"][0]["sensors"]
        if sensor["name"] == "scanner"
    )
    high_m = 0.0 if scanner["mount"] == "lidar" else scanner["mount"]["xyz_m"][2]
    far_m = 10.0 if "utm30lx" in scanner["datasheet"] else 20.0
    numbers = dict.fromkeys(("largest_m", "start_to_end_m", "way_m", "scale", "took_s"), 1.0)
    return Evaluation(
        experiment="swept",
        program="a program",
        case="",
        seed=1,
        ate_m=far_m + high_m,
        poses=1,
        limit_m=0.1,
        **numbers,
    )


@pytest.fixture(autouse=True)
def swept(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(options: ExperimentOptions) -> Sequence[Evaluation]:
        return [result(options)]

    monkeypatch.setitem(module.EXPERIMENTS, "swept", Experiment(run, minutes=0))


def test_each_combination_is_run_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["swept", "--vary", SHEETS, "--vary", MOUNTS, "--out", str(tmp_path)]
    assert module.main(words) == 0
    table = read_csv(tmp_path / "tables" / "sweeps" / "swept.csv")
    assert {row.case: row.ate_m for row in table} == {
        "scanner.datasheet utm30lx, scanner.mount lidar": 10.0,
        'scanner.datasheet utm30lx, scanner.mount {"xyz_m": [0.2, 0.0, 0.9]}': 10.9,
        "scanner.datasheet lms111, scanner.mount lidar": 20.0,
        'scanner.datasheet lms111, scanner.mount {"xyz_m": [0.2, 0.0, 0.9]}': 20.9,
    }
    assert "| a program, scanner.datasheet lms111, scanner.mount lidar | 20.00 m |" in (
        capsys.readouterr().out
    )


@pytest.mark.parametrize(
    "text", ["scanner.mount", "mount=[1]", "scanner.mount=lidar", "scanner.mount=[", "a.b=[]"]
)
def test_invalid_variation_gives_one_line(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert module.main(["swept", "--vary", text, "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"groundlink sweep: --vary {text}: expected SENSOR")


def test_unknown_sensor_gives_one_line() -> None:
    with pytest.raises(
        UserError, match=r"^swept: unknown sensor lidar; expected one of scanner, imu,"
    ):
        SETUP.varied({"lidar": {"mount": "lidar"}})


def test_command_forwards_its_arguments(capfd: pytest.CaptureFixture[str]) -> None:
    assert groundlink(["sweep", "indoor_scans", "--vary", "nothing"]) == 2
    assert capfd.readouterr().err.startswith("groundlink sweep: --vary nothing: expected")
