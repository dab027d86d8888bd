# SPDX-License-Identifier: Apache-2.0
"""Tracks in soil agree with the closed form of Bekker, and Janosi and Hanamoto."""

from math import exp, radians, sqrt, tan

import numpy as np
import pytest
from msgspec.structs import replace

from services.physics.soil.table import track_table
from services.physics.soil.track import TrackSection, track_forces, track_sinkage
from tests.services.physics.soil.test_wheel import SOILS

WIDTH, SPACING, DIAMETER, PITCH = 0.58, 0.96, 0.81, 0.137
WHEELS, LOAD = 5, 35e3


def section(i: int) -> TrackSection:
    return TrackSection(WIDTH, SPACING, SPACING * i, DIAMETER, PITCH)


def closed_thrust(name: str, slip: float) -> float:
    """Return the thrust of the whole track under even pressure."""
    soil, length = SOILS[name], WHEELS * SPACING
    strength = WIDTH * length * soil.cohesion_pa + WHEELS * LOAD * tan(
        radians(soil.friction_angle_deg)
    )
    k = soil.shear_displacement_m
    return strength * (1 - k / (slip * length) * (1 - exp(-slip * length / k)))


@pytest.mark.parametrize("name", ["dry_sand", "lete_sand", "clayey_soil_55", "snow_sweden"])
@pytest.mark.parametrize("slip", [0.004, 0.03, 0.2, 0.8])
def test_thrust_over_slip_is_the_closed_form(name: str, slip: float) -> None:
    thrust = sum(
        track_table(SOILS[name], section(i), LOAD).at(LOAD, slip).thrust_n for i in range(WHEELS)
    )
    assert thrust == pytest.approx(closed_thrust(name, slip), rel=0.02)


@pytest.mark.parametrize("name", ["dry_sand", "lete_sand", "clayey_soil_55"])
def test_sinkage_and_resistance_are_the_closed_form(name: str) -> None:
    """Rowland's peak pressure, Bekker's sinkage, the work of compaction under the first wheel."""
    soil = replace(SOILS[name], slip_sinkage=0.0)
    modulus = soil.k_c / WIDTH + soil.k_phi
    sinkage = (1.26 * LOAD / (WIDTH * sqrt(PITCH * DIAMETER)) / modulus) ** (1 / soil.n)
    found = track_table(soil, section(0), LOAD).at(LOAD, 0.1)
    assert found.sinkage_m == pytest.approx(sinkage, rel=0.02)
    work = WIDTH * modulus * sinkage ** (soil.n + 1) / (soil.n + 1)
    assert found.resistance_n == pytest.approx(work, rel=0.02)
    behind = track_table(soil, section(1), LOAD).at(LOAD, 0.1, rut=1.0)
    assert behind.sinkage_m == pytest.approx(sinkage, rel=0.02)
    assert behind.resistance_n == pytest.approx(0.0, abs=1e-3 * work)


@pytest.mark.parametrize("slip", [0.2, 0.5, 1.0])
def test_slip_sinkage_of_a_track_is_lyaskos(slip: float) -> None:
    load = np.array(LOAD / 4)
    still = track_sinkage(SOILS["dry_sand"], section(0), load, np.array(0.0))
    found = track_sinkage(SOILS["dry_sand"], section(0), load, np.array(slip))
    assert found / still == pytest.approx((1 + slip) / (1 - slip / 2))


def test_a_braked_track_is_a_driven_one_backwards() -> None:
    load = np.array(LOAD)
    ahead = track_forces(SOILS["dry_sand"], section(2), load, np.array(0.1))
    back = track_forces(SOILS["dry_sand"], section(2), load, np.array(-0.1))
    assert back.thrust_n == -ahead.thrust_n
    assert back.resistance_n == ahead.resistance_n
