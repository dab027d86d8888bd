# SPDX-License-Identifier: Apache-2.0
"""Who runs several experiments gets all of them, and hears at the end what was not kept."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from experiments import __main__ as module
from experiments.estimation.evaluation import Evaluation, read_csv
from experiments.experiment import Experiment, ExperimentOptions
from groundlink.core.errors import UserError

from .test_evaluation import ONE

Run = Callable[[ExperimentOptions], Sequence[Evaluation]]


def one_of(ate_m: float) -> Run:
    """An experiment whose error is so large, of which 5 cm are accepted."""
    return lambda _: [replace(ONE, program="a program", case="", ate_m=ate_m, limit_m=0.05)]


def broken(_: ExperimentOptions) -> Sequence[Evaluation]:
    raise UserError("its program needs libGL.so.1")


@pytest.mark.parametrize(
    ("runs", "code", "not_kept"),
    [
        ({"near": one_of(0.01)}, 0, []),
        ({"far": one_of(0.06), "near": one_of(0.01)}, 1, ["0.0600 m, expected below 0.05 m"]),
        (
            {"none": broken, "far": one_of(0.06)},
            2,
            ["none, not run to its end", "0.0600 m, expected below 0.05 m"],
        ),
    ],
    ids=["all kept", "one too far off", "one cannot be run"],
)
def test_each_experiment_runs_and_missed_limits_are_reported(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    runs: dict[str, Run],
    code: int,
    not_kept: list[str],
) -> None:
    table = {name: Experiment(run, minutes=0) for name, run in runs.items()}
    monkeypatch.setattr(module, "EXPERIMENTS", table)
    assert module.main([*runs, "--out", str(tmp_path)]) == code
    said = capsys.readouterr()
    lines = said.err.splitlines()
    assert all(line.startswith("not kept: ") for line in lines)
    assert all(line.endswith(end) for line, end in zip(lines, not_kept, strict=True))
    written = {file.stem for file in (tmp_path / "tables").glob("*.csv")}
    assert written == runs.keys() - {"none"}
    assert all(read_csv(tmp_path / "tables" / f"{name}.csv") for name in written)
    assert ("its program needs libGL.so.1" in said.out) == ("none" in runs)


def test_unknown_experiment_gives_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert module.main(["indoor_scan"]) == 2
    assert capsys.readouterr().err.startswith("no experiment indoor_scan; expected some of trans")
