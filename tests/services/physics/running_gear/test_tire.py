# SPDX-License-Identifier: Apache-2.0
"""The tire's law of friction."""

from math import atan, cos, hypot, radians, sin

import pytest

from groundlink.scenario.vehicle import TireSlip
from services.physics.running_gear.tire import TREAD_STIFFNESS, Tire

STEP = 0.0025
BORNE_KG = 14.0
STIFFNESS_NPM = TREAD_STIFFNESS * BORNE_KG / STEP**2


def tire_of(axle_ratio: float = 1.0) -> Tire:
    return Tire(borne_kg=BORNE_KG, axle_ratio=axle_ratio)


def slide(
    tire: Tire,
    x: float,
    y: float,
    *,
    limit: float = 100.0,
    steps: int = 400,
    tread: float = 0.0,
    load: float = 0.0,
) -> tuple[float, float]:
    force = (0.0, 0.0)
    for _ in range(steps):
        tire.meet(x, y, limit, 0.0, load)
        force = tire.settle(tread)
    return force


@pytest.mark.parametrize("degrees", [0, 30, 45, 90, 200, 315])
def test_a_sliding_tire_is_braked_against_its_slip_with_all_it_has(degrees: int) -> None:
    x, y = cos(radians(degrees)), sin(radians(degrees))
    assert slide(tire_of(), x, y) == pytest.approx((-100 * x, -100 * y), abs=1e-6)


def test_a_tread_that_turns_pushes_and_one_that_rolls_does_not() -> None:
    assert slide(tire_of(), 1.0, 0.0, tread=2.0) == pytest.approx((100.0, 0.0))
    assert slide(tire_of(), 1.0, 0.0, tread=1.0) == pytest.approx((0.0, 0.0))


def test_along_the_axle_it_holds_less_where_told_so() -> None:
    assert slide(tire_of(0.6), 0.0, 1.0) == pytest.approx((0.0, -60.0))
    assert slide(tire_of(0.6), 1.0, 0.0) == pytest.approx((-100.0, 0.0))
    x, y = slide(tire_of(0.6), 1.0, 1.0)
    assert hypot(x / 100, y / 60) == pytest.approx(1.0)


def test_it_sticks_below_its_limit() -> None:
    tire = tire_of()
    # Bent by a millimeter, then at rest: a spring that does not let go.
    slide(tire, 0.0, 0.001 / (10 * STEP), steps=10)
    assert slide(tire, 0.0, 0.0) == pytest.approx((0.0, -0.001 * STIFFNESS_NPM))


def test_after_slipping_it_does_not_spring_back_further_than_it_was_bent() -> None:
    tire = tire_of()
    slide(tire, 5.0, 0.0)
    assert slide(tire, 0.0, 0.0, steps=1)[0] == pytest.approx(-100.0, rel=0.2)
    assert slide(tire, -0.1, 0.0, steps=400)[0] == pytest.approx(100.0)


@pytest.mark.parametrize("limit", [0.0, -1.0])
def test_in_the_air_there_is_no_grip_and_no_memory(limit: float) -> None:
    tire = tire_of()
    slide(tire, 1.0, 1.0)
    assert slide(tire, 1.0, 1.0, limit=limit, steps=1) == (0.0, 0.0)
    assert slide(tire, 0.0, 0.0, steps=1) == (0.0, 0.0)


@pytest.mark.parametrize("tread", [-1.0, 0.0, 0.3, 0.5, 0.7, 2.0])
def test_its_gain_is_the_slope_of_its_force(tread: float) -> None:
    tire = tire_of()
    tire.meet(0.5, 0.1, 100.0)
    below, above = tire.along(tread - 1e-6)[0], tire.along(tread + 1e-6)[0]
    assert tire.along(tread)[1] == pytest.approx((above - below) / 2e-6, rel=1e-4, abs=1e-6)
    assert tire.along(tire.rolling_mps)[0] == pytest.approx(0.0)


SLIP = TireSlip(cornering_stiffness_nprad=1500.0, load_n=200.0)


def creeping(axle_ratio: float = 1.0) -> Tire:
    return Tire(borne_kg=BORNE_KG, axle_ratio=axle_ratio, slip=SLIP)


@pytest.mark.parametrize("speed", [0.5, 5.0, 20.0])
@pytest.mark.parametrize("slip", [0.001, 0.02, 0.1, 0.25])
def test_a_rolling_tire_has_the_forces_of_the_brush_model(speed: float, slip: float) -> None:
    limit, load = 100.0, 125.0
    stiffness = 1500.0 * sin(2 * atan(load / 200.0))
    force = limit * (1 - max(0.0, 1 - stiffness * slip / (3 * limit)) ** 3)
    aside = slide(creeping(), speed, slip * speed, tread=speed, load=load)
    assert aside == pytest.approx((0.0, -force), rel=1e-3, abs=1e-6)
    driven = slide(creeping(), speed, 0.0, tread=speed * (1 + slip), load=load)
    assert driven == pytest.approx((force, 0.0), rel=slip + 1e-3)


def test_a_creeping_tire_that_stands_sticks() -> None:
    tire = creeping()
    slide(tire, 0.0, 0.001 / (10 * STEP), steps=10, load=125.0)
    assert slide(tire, 0.0, 0.0, load=125.0) == pytest.approx((0.0, -0.001 * STIFFNESS_NPM))
