# SPDX-License-Identifier: Apache-2.0
"""The smallest change of a field, of two scenarios or of faults is found, with runs of a stub."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink
from groundlink.cli.bisect import recorders
from groundlink.cli.commands import parser
from groundlink.cli.run.cases import Case
from groundlink.loader import load
from groundlink.loader.overrides import FieldChange

from .toys import RECORDING

Judge = Callable[[dict[str, object]], int]

SCENARIO = """
name: good
world: lab
vehicles:
  - name: rover
    model: rover
    route: {kind: circle, laps: 3}
    sensors:
      - {kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link, rate_hz: 50.0}
      - kind: imu
        datasheet: imu_mti1
        name: imu
        topic: /imu
        frame: imu_link
        mount: imu
        faults:
          - {kind: drop, share: 0.5, at_s: 1.0, for_s: 1.0}
          - {kind: delay, delay_s: 0.01, at_s: 2.0}
          - {kind: stuck, at_s: 3.0}
"""


class Runs(list[dict[str, object]]):
    """The changed fields of each run."""

    judge: Judge = staticmethod(lambda fields: 0)
    """Returns the exit code of a run with changed fields."""


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Runs:
    """Runs of a stub, in a folder with `good.yaml`."""
    made = Runs()

    def record(scenario: str, case: Case, to: Path, duration: str | None) -> int:
        made.append({change.field: change.value for change in case})
        code = made.judge(made[-1])
        if code in (0, 1):
            shutil.copy(RECORDING, to)
        return code

    monkeypatch.setattr(recorders, "record_case", record)
    monkeypatch.chdir(tmp_path)
    Path("good.yaml").write_text(SCENARIO, encoding="utf-8")
    return made


def found(capsys: pytest.CaptureFixture[str]) -> dict[str, object]:
    printed: dict[str, object] = json.loads(capsys.readouterr().out)
    return printed


SPEED = ["bisect", "good.yaml", "--set", "route.speed_mps"]
RANGE = [*SPEED, "--good", "0.5", "--bad", "1.5"]


def is_fast(fields: dict[str, object]) -> int:
    return int(float(str(fields["route.speed_mps"])) > 0.873)


@pytest.mark.parametrize(
    ("resolution", "good", "bad", "most"),
    [([], 0.87, 0.88, 9), (["--resolution", "0.1"], 0.8, 0.9, 6)],
)
def test_bad_speed_is_found(
    resolution: list[str],
    good: float,
    bad: float,
    most: int,
    runs: Runs,
    capsys: pytest.CaptureFixture[str],
) -> None:
    runs.judge = is_fast
    assert groundlink([*RANGE, *resolution, "--set", "seed=4", "--json"]) == 0
    result = found(capsys)
    assert result["changes"] == [{"field": "route.speed_mps", "good": good, "bad": bad}]
    assert result["runs"] == len(runs) <= most
    assert len({fields["route.speed_mps"] for fields in runs}) == len(runs)
    assert {fields["seed"] for fields in runs} == {4}
    assert result["first_difference"] is None, "the stub always records the same"
    assert Path("bisect/good.mcap").read_bytes() == RECORDING.read_bytes()


def test_values_of_a_list_have_its_order(runs: Runs, capsys: pytest.CaptureFixture[str]) -> None:
    runs.judge = lambda fields: int(fields["imu.datasheet"] == "imu_mpu6000")
    values = "imu.datasheet=imu_mti1,imu_vn100,imu_mpu6000"
    assert groundlink(["bisect", "good.yaml", "--set", values]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "imu.datasheet: imu_mti1 (good) to imu_mpu6000 (bad), 3 values"
    assert "imu.datasheet: good at imu_vn100, bad at imu_mpu6000; 3 probes" in lines
    assert "no difference between both recordings" in lines


def test_interrupted_bisection_continues(runs: Runs, capsys: pytest.CaptureFixture[str]) -> None:
    def judge(fields: dict[str, object]) -> int:
        if len(runs) == 4:
            raise KeyboardInterrupt
        return is_fast(fields)

    runs.judge = judge
    assert groundlink(RANGE) == 130
    assert "bisect has the finished runs; the same command continues" in capsys.readouterr().out
    runs.judge = is_fast
    assert groundlink(RANGE) == 0
    assert "8 probes, 3 of them from an earlier bisection" in capsys.readouterr().out
    speeds = [fields["route.speed_mps"] for fields in runs]
    assert speeds[3] == speeds[4], "the interrupted run is repeated"
    assert len({*speeds}) == len(speeds) - 1

    runs.clear()
    check = ["--", "sh", "-c", "exit 1"]
    assert groundlink([*RANGE, *check]) == 2
    assert runs == [], "another check needs no other runs"
    assert groundlink([*RANGE, "--duration", "5"]) == 2
    assert "with another duration" in capsys.readouterr().err


def test_check_decides(runs: Runs, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs.judge = lambda fields: 1  # a run that went wrong, but not in what the check judges
    check = tmp_path / "check.sh"
    check.write_text('echo "$1" "$2"\nexit $(($(basename "$2" .mcap) == $1))\n', encoding="utf-8")
    words = ["bisect", "good.yaml", "--set", "seed", "--good", "3", "--bad", "9"]
    assert groundlink([*words, "--", "sh", str(check), "2"]) == 0
    assert f"  bad: 2 {tmp_path}/bisect/2.mcap" in capsys.readouterr().out.splitlines()
    assert [fields["seed"] for fields in runs] == [3, 9], "seeds have no order"


@pytest.mark.parametrize(
    ("codes", "line"),
    [
        ("1 1", "the good end is bad: route.speed_mps=0.5: exit code 1; expected good"),
        ("0 0", "the bad end is good: route.speed_mps=1.5: exit code 0; expected bad"),
        ("3 1", "the good end is not judged: route.speed_mps=0.5: exit code 3; expected good"),
    ],
)
def test_wrong_end_is_one_line(
    codes: str, line: str, runs: Runs, capsys: pytest.CaptureFixture[str]
) -> None:
    runs.judge = lambda fields: int(codes.split()[len(runs) - 1])
    assert groundlink(RANGE) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("command", ["exit 127;", "kill -9 $$;"])
def test_check_that_does_not_run_is_no_verdict(
    command: str, runs: Runs, capsys: pytest.CaptureFixture[str]
) -> None:
    assert groundlink([*RANGE, "--", "sh", "-c", command]) == 2
    assert "exit code" in capsys.readouterr().err


def test_values_that_cannot_be_judged_are_named(
    runs: Runs, capsys: pytest.CaptureFixture[str]
) -> None:
    speeds = {"0.5": 0, "0.6": 0, "0.7": 4, "0.8": 1, "0.9": 1}
    runs.judge = lambda fields: speeds[str(fields["route.speed_mps"])]
    words = [*SPEED, "--good", "0.5", "--bad", "0.9", "--resolution", "0.1"]
    assert groundlink(words) == 1
    printed = capsys.readouterr().out
    assert "route.speed_mps: good at 0.6, bad at 0.8" in printed
    assert "not judged, and possibly the first bad one: route.speed_mps=0.7" in printed


BAD = (
    SCENARIO.replace("name: good", "name: bad\nseed: 8")
    .replace("world: lab", "world: lab\ntime: {clock_rate_hz: 50}")
    .replace("laps: 3", "laps: 2, speed_mps: 0.6")
    .replace("rate_hz: 50.0", "rate_hz: 25.0, slip_stddev: 0.1")
)
FIELDS = {
    "seed": 8,
    "time": {"clock_rate_hz": 50},
    "route.laps": 2,
    "route.speed_mps": 0.6,
    "encoders.rate_hz": 25.0,
    "encoders.slip_stddev": 0.1,
}


@pytest.mark.parametrize(
    "needed", [("seed",), ("route.speed_mps", "encoders.slip_stddev"), tuple(FIELDS)]
)
def test_needed_fields_of_two_scenarios_are_found(
    needed: tuple[str, ...], runs: Runs, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("bad.yaml").write_text(BAD, encoding="utf-8")
    runs.judge = lambda fields: int({*needed} <= {*fields})
    assert groundlink(["bisect", "--good", "good.yaml", "--bad", "bad.yaml", "--json"]) == 0
    result = found(capsys)
    assert isinstance(result["changes"], list)
    assert {each["field"]: each["bad"] for each in result["changes"]} == {
        name: FIELDS[name] for name in needed
    }
    assert runs[:2] == [{}, FIELDS]
    assert len(runs) == len({json.dumps(fields) for fields in runs})


def test_good_scenario_gets_the_defaults_of_what_the_bad_one_leaves_out(
    runs: Runs, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("bad.yaml").write_text(BAD, encoding="utf-8")
    runs.judge = lambda fields: int("encoders.slip_stddev" in fields)
    assert groundlink(["bisect", "--good", "bad.yaml", "--bad", "good.yaml", "--json"]) == 0
    assert found(capsys)["changes"] == [{"field": "encoders.slip_stddev", "bad": 0.0}]


def test_needed_fault_is_found(runs: Runs, capsys: pytest.CaptureFixture[str]) -> None:
    field = "vehicles.rover.sensors.imu.faults"

    def judge(fields: dict[str, object]) -> int:
        change = FieldChange(field, fields[field])
        (vehicle,) = load("good.yaml", changes=[change]).vehicles
        return int({"drop", "stuck"} <= {fault.kind for fault in vehicle.sensors[1].faults})

    runs.judge = judge
    assert groundlink(["bisect", "good.yaml", "--faults"]) == 0
    printed = capsys.readouterr().out
    assert "needed: rover/imu fault 1 (drop) and rover/imu fault 3 (stuck)" in printed
    assert runs[0] == {field: []}


PARTS = ["bisect", "good.yaml", "--faults"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["bisect"], "--good and --bad: expected both"),
        (["bisect", "good.yaml"], "a scenario alone"),
        (["bisect", "--set", "seed", "--good", "1", "--bad", "2"], "the scenario is missing"),
        ([*PARTS, "--good", "1"], "--faults: expected no --good and --bad"),
        ([*PARTS, "--set", "seed"], "--faults and --set FIELD: expected one of them"),
        ([*SPEED, "--good", "1"], "--good and --bad: expected both"),
        ([*SPEED, "--good", "1", "--bad", "1"], "expected a bad value that is not the good one"),
        ([*RANGE, "--set", "imu.rate_hz"], "expected one varied field"),
        ([*RANGE, "--resolution", "0"], "--resolution 0.0: expected a number, more than 0"),
        ([*RANGE, "--duration", "soon"], "--duration soon: expected seconds"),
        ([*SPEED, "--good", "0.5", "--bad", "fast"], "route.speed_mps`: expected `float`"),
        (["bisect", "good.yaml", "--set", "route.speed=1,2"], "`vehicles[0].route.speed`"),
        (["bisect", "good.yaml", "--set", "seed=1,2,3"], "seeds have no order"),
        (["bisect", "good.yaml", "--set", "nothing", "--good", "1", "--bad", "2"], "`nothing`"),
        (["bisect", "--good", "good.yaml", "--bad", "good.yaml"], "do not differ"),
        (["bisect", "--good", "good.yaml", "--bad", "none.yaml"], "none.yaml: no such file"),
        (["bisect", "indoor_lab", "--faults"], "no sensor has faults"),
        ([*RANGE, "--build", "make"], "--build: expected --repository"),
        ([*RANGE, "--program", "make"], "--program: expected --repository, and no --set"),
        ([*RANGE, "--out", "."], "holds other files"),
    ],
)
def test_mistake_is_one_line_before_the_first_run(
    words: list[str], line: str, runs: Runs, capsys: pytest.CaptureFixture[str]
) -> None:
    assert groundlink(words) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert runs == []


def test_scenarios_with_other_files_are_refused(
    runs: Runs, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    for folder, radius_m in ((tmp_path, 1.0), (other, 2.0)):
        route = f"{{kind: circle, radius_m: {radius_m}}}\n"
        (folder / "round.yaml").write_text(route, encoding="utf-8")
        text = SCENARIO.replace("{kind: circle, laps: 3}", "round.yaml")
        text = text.replace("name: good", f"name: good\nseed: {radius_m:.0f}")
        (folder / "scenario.yaml").write_text(text, encoding="utf-8")
    words = ["bisect", "--good", "scenario.yaml", "--bad", "other/scenario.yaml"]
    assert groundlink(words) == 2
    assert "`vehicles[0].route.radius_m` differs" in capsys.readouterr().err


@pytest.mark.parametrize("words", [[], ["--", "python", "check.py", "--good", "--", "x"]])
def test_words_after_the_dashes_are_the_check(words: list[str]) -> None:
    options = parser().parse_args([*RANGE, *words])
    assert (options.scenario, options.good) == ("good.yaml", "0.5")
    assert options.check == words[1:]
