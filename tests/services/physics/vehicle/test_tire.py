# SPDX-License-Identifier: Apache-2.0
"""The tyre's law of friction."""

from __future__ import annotations

from math import cos, hypot, radians, sin

import pytest

from services.physics.vehicle.tire import TREAD_STIFFNESS, Tyre

STEP = 0.0025
BORNE_KG = 14.0
STIFFNESS_NPM = TREAD_STIFFNESS * BORNE_KG / STEP**2


def tyre_of(axle_ratio: float = 1.0) -> Tyre:
    return Tyre(borne_kg=BORNE_KG, axle_ratio=axle_ratio)


def slide(
    tyre: Tyre, x: float, y: float, *, limit: float = 100.0, steps: int = 400, tread: float = 0.0
) -> tuple[float, float]:
    force = (0.0, 0.0)
    for _ in range(steps):
        tyre.meet(x, y, limit)
        force = tyre.settle(tread)
    return force


@pytest.mark.parametrize("degrees", [0, 30, 45, 90, 200, 315])
def test_a_sliding_tyre_is_braked_against_its_slip_with_all_it_has(degrees: int) -> None:
    x, y = cos(radians(degrees)), sin(radians(degrees))
    assert slide(tyre_of(), x, y) == pytest.approx((-100 * x, -100 * y), abs=1e-6)


def test_a_tread_that_turns_pushes_and_one_that_rolls_does_not() -> None:
    assert slide(tyre_of(), 1.0, 0.0, tread=2.0) == pytest.approx((100.0, 0.0))
    assert slide(tyre_of(), 1.0, 0.0, tread=1.0) == pytest.approx((0.0, 0.0))


def test_along_the_axle_it_holds_less_where_told_so() -> None:
    assert slide(tyre_of(0.6), 0.0, 1.0) == pytest.approx((0.0, -60.0))
    assert slide(tyre_of(0.6), 1.0, 0.0) == pytest.approx((-100.0, 0.0))
    x, y = slide(tyre_of(0.6), 1.0, 1.0)
    assert hypot(x / 100, y / 60) == pytest.approx(1.0)


def test_it_sticks_below_its_limit() -> None:
    tyre = tyre_of()
    # Bent by a millimetre, then at rest: a spring that does not let go.
    slide(tyre, 0.0, 0.001 / (10 * STEP), steps=10)
    assert slide(tyre, 0.0, 0.0) == pytest.approx((0.0, -0.001 * STIFFNESS_NPM))


def test_after_slipping_it_does_not_spring_back_further_than_it_was_bent() -> None:
    tyre = tyre_of()
    slide(tyre, 5.0, 0.0)
    assert slide(tyre, 0.0, 0.0, steps=1)[0] == pytest.approx(-100.0, rel=0.2)
    assert slide(tyre, -0.1, 0.0, steps=400)[0] == pytest.approx(100.0)


@pytest.mark.parametrize("limit", [0.0, -1.0])
def test_in_the_air_there_is_no_grip_and_no_memory(limit: float) -> None:
    tyre = tyre_of()
    slide(tyre, 1.0, 1.0)
    assert slide(tyre, 1.0, 1.0, limit=limit, steps=1) == (0.0, 0.0)
    assert slide(tyre, 0.0, 0.0, steps=1) == (0.0, 0.0)


@pytest.mark.parametrize("tread", [-1.0, 0.0, 0.3, 0.5, 0.7, 2.0])
def test_its_gain_is_the_slope_of_its_force(tread: float) -> None:
    tyre = tyre_of()
    tyre.meet(0.5, 0.1, 100.0)
    below, above = tyre.along(tread - 1e-6)[0], tyre.along(tread + 1e-6)[0]
    assert tyre.along(tread)[1] == pytest.approx((above - below) / 2e-6, rel=1e-4, abs=1e-6)
    assert tyre.along(tyre.rolling_mps)[0] == pytest.approx(0.0)
