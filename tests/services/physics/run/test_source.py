# SPDX-License-Identifier: Apache-2.0
"""What physics is told to simulate: a scenario, a saved run to go on from, or one to do again."""

import argparse
from pathlib import Path

import pytest

from groundlink.core.errors import UserError
from groundlink.episode.journal import Journal, dumped, this_platform
from groundlink.loader import load
from services.physics.run.source import RunSource, add_arguments, source_of

LAB = Path(__file__).parents[4] / "scenarios" / "indoor_lab_tour.yaml"


def chosen(*words: str) -> RunSource:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return source_of(parser.parse_args(words))


@pytest.fixture(scope="module")
def saved() -> Journal:
    return Journal(
        made_on=this_platform(),
        run="run",
        episode=1,
        epoch_nanos=0,
        scenario=load(LAB),
        tick=9,
        digest="",
        entries=(),
    )


@pytest.fixture
def file(saved: Journal, tmp_path: Path) -> str:
    (tmp_path / "a.run").write_bytes(dumped(saved))
    return str(tmp_path / "a.run")


def test_a_scenario_is_one(saved: Journal) -> None:
    assert chosen(str(LAB)) == RunSource(saved.scenario)


def test_a_saved_run_takes_its_place(saved: Journal, file: str) -> None:
    assert chosen(file) == RunSource(saved.scenario, saved=saved)
    assert chosen(file, "--mode", "fast").scenario.time.mode == "fast"


def test_followed_run_needs_no_driver(saved: Journal, file: str) -> None:
    found = chosen("--follow", file)
    assert found.followed == saved
    assert [vehicle.route for vehicle in found.scenario.vehicles] == [None]
    assert saved.scenario.vehicles[0].route is not None


def test_one_of_them_is_expected(file: str) -> None:
    for words in ((), (file, "--follow", file)):
        with pytest.raises(UserError, match="expected a scenario file, a saved run, or --follow"):
            chosen(*words)


def test_other_file_cannot_be_followed() -> None:
    with pytest.raises(UserError, match=r"indoor_lab_tour.yaml: not a saved run"):
        chosen("--follow", str(LAB))
