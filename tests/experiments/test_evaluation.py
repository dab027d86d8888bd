# SPDX-License-Identifier: Apache-2.0
"""Results: a table that reads back, medians over seeds, and limits that are missed."""

from dataclasses import replace
from pathlib import Path

from experiments.estimation.evaluation import Evaluation, median, missed, read_csv, write_csv

ONE = Evaluation(
    experiment="indoor",
    program="slam",
    case="",
    seed=1,
    ate_m=0.01,
    largest_m=0.03,
    start_to_end_m=0.02,
    way_m=30.25,
    poses=400,
    scale=1.0,
    took_s=12.5,
    limit_m=0.02,
)


def with_errors(*errors_m: float, case: str = "") -> list[Evaluation]:
    return [replace(ONE, seed=i, ate_m=e, case=case) for i, e in enumerate(errors_m, 1)]


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    write_csv(tmp_path / "table.csv", [ONE])
    assert read_csv(tmp_path / "table.csv") == [ONE]


def test_the_median_is_what_counts() -> None:
    assert median(with_errors(0.01, 0.5, 0.015)) == 0.015
    assert missed(with_errors(0.01, 0.5, 0.015)) == []
    assert missed(with_errors(0.01, 0.03, 0.02)) == [
        "indoor, slam : 0.0200 m, expected below 0.02 m"
    ]


def test_a_relative_error_has_its_own_limit() -> None:
    results = [replace(r, limit_over_100_m=0.01) for r in with_errors(0.01, 0.01, 0.01)]

    def found(*shares: float) -> list[str]:
        pairs = zip(results, shares, strict=True)
        return missed([replace(result, over_100_m=share) for result, share in pairs])

    assert found(0.002, 0.02, 0.003) == []
    assert found(0.002, 0.02, 0.013) == ["indoor, slam : 1.30% over 100 m, expected below 1.00%"]
    assert found(0.0, 0.0, 0.0), "a path of less than 100 m has no relative error"
    assert found(*3 * (float("nan"),))


def test_each_case_has_its_own_limit() -> None:
    alone = [replace(r, limit_m=0.0) for r in with_errors(1.0, 2.0, 3.0, case="odometry alone")]
    assert missed([*with_errors(0.01), *alone]) == []


def test_values_that_are_no_numbers_are_missing() -> None:
    assert missed(with_errors(float("nan")))
