# SPDX-License-Identifier: Apache-2.0
"""Rigid wheels in soil agree with the closed form of Bekker, Wong, Reece, Janosi, Hanamoto."""

import numpy as np
import pytest
from msgspec.structs import replace

from services.physics.soil.stress import pressure, rebound, repeated
from services.physics.soil.table import wheel_table
from services.physics.soil.wheel import DEEPEST, wheel_forces, wheel_sinkage
from tests.services.physics.grounds import SOILS
from tests.services.physics.soil.closed_form import RigidWheel, bekker_sinkage

RADIUS, WIDTH, LOAD = 0.1651, 0.1143, 135.0


FIRM = (
    *("dry_sand", "lete_sand", "sandy_loam_22", "upland_sandy_loam"),
    *("north_gower_clayey_loam", "clayey_soil_55", "heavy_clay_40", "lunar_regolith"),
)
"""Soils that carry the wheel well above its hub."""


def test_at_least_eight_soils_of_all_kinds_are_shipped() -> None:
    assert len(SOILS) >= 8
    assert all(any(kind in name for name in SOILS) for kind in ("sand", "loam", "clay", "snow"))


@pytest.mark.parametrize("slip_sinkage", [0.0, 1.0])
@pytest.mark.parametrize("slip", [-0.4, 0.0, 0.15, 0.7])
@pytest.mark.parametrize("name", FIRM)
def test_the_table_is_the_closed_form(name: str, slip: float, slip_sinkage: float) -> None:
    """Sinkage, thrust, resistance and drawbar pull within 2 % (of the load, where near zero)."""
    soil = replace(SOILS[name], slip_sinkage=slip_sinkage)
    exact = RigidWheel(soil, RADIUS, WIDTH, slip)
    sinkage = exact.sinkage(LOAD)
    thrust, drawbar = exact.torque(sinkage) / RADIUS, exact.drawbar(sinkage)
    found = wheel_table(soil, RADIUS, WIDTH, LOAD).at(LOAD, slip)
    assert found.sinkage_m == pytest.approx(sinkage, rel=0.02)
    near = 0.002 * LOAD
    assert found.thrust_n == pytest.approx(thrust, rel=0.02, abs=near)
    assert found.resistance_n == pytest.approx(thrust - drawbar, rel=0.02, abs=near)
    assert found.thrust_n - found.resistance_n == pytest.approx(drawbar, rel=0.02, abs=2 * near)


@pytest.mark.parametrize("load", [40.0, 90.0, 250.0])
def test_other_loads(load: float) -> None:
    table = wheel_table(SOILS["dry_sand"], RADIUS, WIDTH, LOAD)
    exact = RigidWheel(SOILS["dry_sand"], RADIUS, WIDTH, 0.2)
    sinkage = exact.sinkage(load)
    found = table.at(load, 0.2)
    assert found.sinkage_m == pytest.approx(sinkage, rel=0.02)
    drawbar = found.thrust_n - found.resistance_n
    assert drawbar == pytest.approx(exact.drawbar(sinkage), abs=0.01 * load)


@pytest.mark.parametrize(("n", "near"), [(0.5, 0.07), (1.0, 0.02), (1.1, 0.02)])
def test_without_shear_resistance_is_the_work_of_compaction(n: float, near: float) -> None:
    """Bekker: R = b k z^(n+1) / (n + 1). His sinkage is that of a parabola instead of a circle, in
    a series of two terms, which is exact for n = 1."""
    soil = replace(
        SOILS["dry_sand"],
        n=n,
        k_phi=4e6,
        cohesion_pa=0.0,
        friction_angle_deg=0.0,
        stress_angle=0.0,
        stress_angle_by_slip=0.0,
    )
    sinkage = wheel_sinkage(soil, RADIUS, WIDTH, np.array(LOAD), np.array(0.0))
    assert sinkage < 0.1 * RADIUS
    assert sinkage == pytest.approx(bekker_sinkage(soil, RADIUS, WIDTH, LOAD), rel=near)
    forces = wheel_forces(soil, RADIUS, WIDTH, sinkage, np.array(0.0))
    work = WIDTH * pressure(soil, WIDTH, sinkage) * sinkage / (n + 1)
    assert forces.resistance_n == pytest.approx(work, rel=1e-3)


def test_slip_digs() -> None:
    slips = np.linspace(0.0, 1.0, 6)
    deep = wheel_sinkage(SOILS["dry_sand"], RADIUS, WIDTH, np.array(LOAD), slips)
    assert np.all(np.diff(deep) > 0)
    assert deep[3] / deep[0] > 1.8


def test_soil_rebounds_along_the_line_of_unloading() -> None:
    soil = replace(SOILS["lete_sand"], unloading_npm3=5e7)
    depth = np.array(0.02)
    most = pressure(soil, WIDTH, depth)
    risen = rebound(soil, depth, most)
    assert risen == pytest.approx(most / 5e7)
    half = repeated(soil, WIDTH, depth - risen / 2, depth)
    assert half == pytest.approx(most / 2)
    assert repeated(soil, WIDTH, depth - 1.01 * risen, depth) == 0.0
    assert repeated(soil, WIDTH, 1.5 * depth, depth) == pytest.approx(
        pressure(soil, WIDTH, 1.5 * depth)
    )


def test_a_second_wheel_rolls_in_the_rut_of_the_first() -> None:
    soil, slip = SOILS["dry_sand"], np.array(0.1)
    first = wheel_sinkage(soil, RADIUS, WIDTH, np.array(LOAD), slip)
    second = wheel_sinkage(soil, RADIUS, WIDTH, np.array(LOAD), slip, first)
    assert first < second < 1.3 * first
    before = wheel_forces(soil, RADIUS, WIDTH, first, slip)
    after = wheel_forces(soil, RADIUS, WIDTH, second, slip, first)
    assert after.load_n == pytest.approx(LOAD, rel=1e-4)
    assert after.resistance_n < 0.5 * before.resistance_n


def test_elastic_soil_takes_no_work_from_a_second_wheel() -> None:
    soil = replace(SOILS["dry_sand"], unloading_npm3=2e7)
    first = wheel_sinkage(soil, RADIUS, WIDTH, np.array(LOAD), np.array(0.0))
    lighter = np.array(LOAD / 2)
    second = wheel_sinkage(soil, RADIUS, WIDTH, lighter, np.array(0.0), first)
    assert second < first
    forces = wheel_forces(soil, RADIUS, WIDTH, second, np.array(0.0), first)
    assert abs(forces.resistance_n) < 0.02 * lighter


def test_deep_snow_swallows_the_wheel() -> None:
    """Soil that cannot carry a load has a sinkage that ends at the limit of the theory."""
    found = wheel_sinkage(SOILS["snow"], RADIUS, WIDTH, np.array(2 * LOAD), np.array(0.5))
    assert found == pytest.approx(DEEPEST * RADIUS)


def test_side_force_is_passive_pressure_over_the_sunken_segment() -> None:
    """With a friction angle of zero it is 2 c times the segment's area, and the weight above."""
    soil = replace(SOILS["clayey_soil_38"], friction_angle_deg=0.0, density_kgpm3=1e-9)
    sinkage = 0.02
    forces = wheel_forces(soil, RADIUS, WIDTH, np.array(sinkage), np.array(0.0))
    entry = np.arccos(1 - sinkage / RADIUS)
    half_segment = RADIUS**2 * (entry - np.sin(entry) * np.cos(entry)) / 2
    assert forces.side_n == pytest.approx(2 * soil.cohesion_pa * half_segment, rel=1e-4)


def test_a_table_repeats_to_the_bit_and_ends_in_proportion() -> None:
    wheel_table.cache_clear()
    one = wheel_table(SOILS["snow_sweden"], RADIUS, WIDTH, LOAD)
    wheel_table.cache_clear()
    other = wheel_table(SOILS["snow_sweden"], RADIUS, WIDTH, LOAD)
    assert one is not other
    assert bytes(one.at(77.7, 0.123, 0.6)) == bytes(other.at(77.7, 0.123, 0.6))
    assert bytes(one.at(0.0, 0.5)) == bytes(6 * 8)
    assert one.at(1.0, 0.5).thrust_n == pytest.approx(one.at(2.0, 0.5).thrust_n / 2)


def test_thrust_without_slip_and_of_a_spinning_wheel_are_in_each_response() -> None:
    table = wheel_table(SOILS["lete_sand"], RADIUS, WIDTH, LOAD)
    found = table.at(LOAD, 0.2)
    assert found.free_n == pytest.approx(table.at(LOAD, 0.0).thrust_n)
    assert found.most_n == pytest.approx(table.at(LOAD, 1.0).thrust_n)
