# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from groundlink.loader.scenario_files import SHIPPED
from services.sensors.gnss.model import GnssErrors
from services.sensors.gnss.spec import Gnss
from services.sensors.noise.random_streams import RandomStreams
from tests.services.sensors.sheets import from_sheet

SHEETS = {
    sheet.stem
    for sheet in (SHIPPED / "sensors").glob("gnss_*.yaml")
    if not sheet.stem.endswith("_fitted")
}

LADDERS = {
    "gnss_neo_m8n": {"single_point": 2.5 / 1.1774, "sbas": 2.0 / 1.1774},
    "gnss_zed_f9p": {
        **{"single_point": 1.5 / 1.1774, "sbas": 1.0 / 1.1774},
        **{"rtk_float": 0.2, "rtk_fix": 0.01 / 1.1774},
    },
}
"""Sheets of receivers whose type of solution changes; values as in `HORIZONTAL_M`."""

HORIZONTAL_M = {
    "gnss_single_point": 2.5 / 1.1774,
    "gnss_sbas": 0.7,
    "gnss_rtk_float": 0.2,
    "gnss_rtk_fix": 0.01 / 1.1774,
}
"""Of each axis: circular errors probable are 1.1774 of it."""


def test_every_kind_of_solution_has_a_sheet() -> None:
    constant = SHEETS - LADDERS.keys()
    assert (
        {f"gnss_{from_sheet(Gnss, name).solution}" for name in constant}
        == constant
        == set(HORIZONTAL_M)
    )
    assert SHEETS >= LADDERS.keys()


@pytest.mark.parametrize("name", sorted(LADDERS))
def test_ladders_have_a_source_and_their_classes_of_accuracy(name: str) -> None:
    spec = from_sheet(Gnss, name)
    assert spec.datasheet
    assert [solution.type for solution in spec.solutions] == list(LADDERS[name])
    for solution in spec.solutions:
        noise = solution.horizontal
        sigma = math.hypot(noise.white_stddev_m, noise.drift_stddev_m)
        assert sigma == pytest.approx(LADDERS[name][solution.type], rel=0.02)
        assert sigma < math.hypot(
            solution.vertical.white_stddev_m, solution.vertical.drift_stddev_m
        )


@pytest.mark.parametrize("name", sorted(HORIZONTAL_M))
def test_sheets_have_a_source_and_their_class_of_accuracy(name: str) -> None:
    spec = from_sheet(Gnss, name)
    assert spec.datasheet
    noise = spec.horizontal
    sigma = math.hypot(noise.white_stddev_m, noise.drift_stddev_m)
    assert sigma == pytest.approx(HORIZONTAL_M[name], rel=0.02)
    assert sigma < math.hypot(spec.vertical.white_stddev_m, spec.vertical.drift_stddev_m)


@pytest.mark.parametrize(("name", "cep_m"), [("gnss_single_point", 2.5), ("gnss_rtk_fix", 0.01)])
def test_half_of_all_fixes_are_within_the_circular_error_probable(name: str, cep_m: float) -> None:
    """One fix of each of many runs, so that the drift is drawn anew."""
    spec = from_sheet(Gnss, name)
    off = np.array([
        GnssErrors(spec, RandomStreams(seed, "rover/gnss")).of_fix(0).position_m
        for seed in range(2000)
    ])  # fmt: skip
    within = np.hypot(off[:, 0], off[:, 1]) < cep_m
    assert np.mean(within) == pytest.approx(0.5, abs=0.04)
