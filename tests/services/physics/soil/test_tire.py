# SPDX-License-Identifier: Apache-2.0
"""Inflated tires in soil agree with the closed form of Bekker and Wong, section 2.6."""

from math import exp, radians, sqrt, tan

import numpy as np
import pytest
from msgspec.structs import replace

from services.physics.soil.tire import InflatedTire, flattens, tire_forces, tire_sinkage
from services.physics.soil.wheel import SoilForces, wheel_forces, wheel_sinkage
from tests.services.physics.soil.test_wheel import SOILS

RADIUS, WIDTH, LOAD = 0.45, 0.3, 8e3
SOFT = ("dry_sand", "lete_sand", "clayey_soil_55", "snow_sweden")


def found(name: str, pressure: float, slip: float, rut: float = 0.0) -> tuple[float, SoilForces]:
    """Return sinkage, and forces at a slip, without slip-sinkage."""
    soil, tire = replace(SOILS[name], slip_sinkage=0.0), InflatedTire(RADIUS, WIDTH, pressure)
    load, s = np.array(LOAD), np.array(slip)
    sunk = tire_sinkage(soil, tire, load, s, rut)
    return float(sunk), tire_forces(soil, tire, sunk, load, s, rut)


def closed(name: str, pressure: float, slip: float) -> tuple[float, float, float]:
    """Return sinkage, resistance and thrust of a flat tire."""
    soil = SOILS[name]
    modulus = soil.k_c / WIDTH + soil.k_phi
    sinkage = (pressure / modulus) ** (1 / soil.n)
    resistance = (
        WIDTH * pressure ** ((soil.n + 1) / soil.n) / ((soil.n + 1) * modulus ** (1 / soil.n))
    )
    length, k = LOAD / (WIDTH * pressure), soil.shear_displacement_m
    strength = WIDTH * length * soil.cohesion_pa + LOAD * tan(radians(soil.friction_angle_deg))
    thrust = strength * (1 - k / (slip * length) * (1 - exp(-slip * length / k)))
    return sinkage, resistance, thrust


def critical_pressure(name: str) -> float:
    """Return the ground pressure above which a tire stays round, by Bekker's rigid wheel."""
    n, modulus = SOILS[name].n, SOILS[name].k_c / WIDTH + SOILS[name].k_phi
    round_pa: float = 3 * LOAD / ((3 - n) * WIDTH * sqrt(2 * RADIUS))
    return float(modulus ** (1 / (2 * n + 1)) * round_pa ** (2 * n / (2 * n + 1)))


@pytest.mark.parametrize("name", SOFT)
@pytest.mark.parametrize("slip", [0.02, 0.2])
def test_a_flat_tire_is_the_closed_form(name: str, slip: float) -> None:
    pressure = 0.4 * critical_pressure(name)
    sunk, forces = found(name, pressure, slip)
    assert (sunk, forces.resistance_n, forces.thrust_n) == pytest.approx(
        closed(name, pressure, slip), rel=1e-6
    )


@pytest.mark.parametrize("name", SOFT)
def test_a_hard_tire_is_a_rigid_wheel(name: str) -> None:
    soil, load, slip = replace(SOILS[name], slip_sinkage=0.0), np.array(LOAD), np.array(0.1)
    sunk, forces = found(name, 2.5 * critical_pressure(name), 0.1)
    rigid = wheel_sinkage(soil, RADIUS, WIDTH, load, slip)
    assert sunk == rigid
    assert forces[1:] == wheel_forces(soil, RADIUS, WIDTH, rigid, slip)[1:]


@pytest.mark.parametrize("name", SOFT)
def test_it_flattens_near_the_critical_pressure(name: str) -> None:
    """Bekker's rigid wheel and that of Wong and Reece sink to depths that differ a little."""
    critical, load, still = critical_pressure(name), np.array(LOAD), np.zeros(())
    tires = [InflatedTire(RADIUS, WIDTH, share * critical) for share in (0.4, 2.5)]
    assert [bool(flattens(SOILS[name], tire, load, still)) for tire in tires] == [True, False]


def test_less_pressure_sinks_less_is_resisted_less_and_pulls_more() -> None:
    critical = critical_pressure("dry_sand")
    cases = [found("dry_sand", share * critical, 0.15) for share in (0.3, 0.5, 0.7)]
    assert np.all(np.diff([sunk for sunk, _ in cases]) > 0.0)
    assert np.all(np.diff([forces.resistance_n for _, forces in cases]) > 0.0)
    assert np.all(np.diff([forces.drawbar_n for _, forces in cases]) < 0.0)


def test_in_its_rut_it_compacts_nothing() -> None:
    pressure = 0.5 * critical_pressure("dry_sand")
    sunk, fresh = found("dry_sand", pressure, 0.05)
    again, behind = found("dry_sand", pressure, 0.05, sunk)
    assert again == sunk
    assert behind.resistance_n == pytest.approx(0.0, abs=1e-9)
    assert behind.thrust_n == fresh.thrust_n
