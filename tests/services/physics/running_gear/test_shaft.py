# SPDX-License-Identifier: Apache-2.0
"""Shafts: what turns them, and what keeps them from turning."""

import pytest

from groundlink.core.clock import TICK_SECONDS
from services.physics.running_gear.shaft import TurningShaft
from services.physics.running_gear.tire import Tire

RADIUS_M, INERTIA = 0.2, 0.05


def shaft(*, damping: float = 0.0, wheels: int = 1) -> TurningShaft:
    tires = [Tire(borne_kg=10.0, axle_ratio=1.0) for _ in range(wheels)]
    return TurningShaft(tires, radius_m=RADIUS_M, inertia_kgm2=INERTIA, damping_nmsprad=damping)


def roll(it: TurningShaft, ground_mps: float, limits: tuple[float, ...], ticks: int = 400) -> float:
    """Turn a free shaft over ground that moves; return the force on its last tire."""
    force = 0.0
    for _ in range(ticks):
        for tire, limit in zip(it.tires, limits, strict=True):
            tire.meet(ground_mps, 0.0, limit)
        it.turn(0.0, 0.0, 0.0)
        force = [tire.settle(it.tread_mps)[0] for tire in it.tires][-1]
    return force


def test_in_the_air_a_motor_turns_it_by_its_torque_and_its_inertia() -> None:
    it = shaft()
    for _ in range(10):
        it.turn(100.0, -2.0, 2.0)
    assert it.speed_radps == pytest.approx(10 * TICK_SECONDS * 2.0 / INERTIA)
    assert it.torque_nm == 2.0
    assert it.angle_rad == pytest.approx(55 * TICK_SECONDS**2 * 2.0 / INERTIA)


def test_strong_motor_holds_the_commanded_speed() -> None:
    it = shaft()
    for _ in range(100):
        it.tires[0].meet(1.0, 0.0, 50.0)
        it.turn(10.0, -20.0, 20.0)
        force, _ = it.tires[0].settle(it.tread_mps)
    assert it.speed_radps == 10.0
    assert force == pytest.approx(50.0)
    assert it.torque_nm == pytest.approx(50.0 * RADIUS_M)


def test_a_motor_that_is_too_weak_stalls_against_the_ground() -> None:
    it = shaft()
    for _ in range(400):
        it.tires[0].meet(0.0, 0.0, 50.0)
        it.turn(10.0, -4.0, 4.0)
        force, _ = it.tires[0].settle(it.tread_mps)
    assert it.speed_radps == pytest.approx(0.0, abs=1e-3)
    assert force == pytest.approx(4.0 / RADIUS_M, rel=1e-3)


@pytest.mark.parametrize("ground_mps", [0.5, -3.0, 20.0])
def test_a_free_wheel_rolls_along(ground_mps: float) -> None:
    it = shaft()
    assert roll(it, ground_mps, (100.0,)) == pytest.approx(0.0, abs=1e-6)
    assert it.tread_mps == pytest.approx(ground_mps)


def test_friction_makes_a_free_wheel_roll() -> None:
    it = shaft()
    roll(it, 5.0, (100.0,), ticks=4)
    assert it.speed_radps == pytest.approx(4 * TICK_SECONDS * 100.0 * RADIUS_M / INERTIA)


def test_bearings_and_rolling_brake_a_free_wheel() -> None:
    assert roll(shaft(damping=0.1), 2.0, (100.0,)) == pytest.approx(-0.1 * 10.0 / RADIUS_M)
    it = shaft()
    for _ in range(400):
        it.tires[0].meet(2.0, 0.0, 100.0, 3.0)
        it.turn(0.0, 0.0, 0.0)
        force, _ = it.tires[0].settle(it.tread_mps)
    assert force == pytest.approx(-3.0, rel=1e-3)


def test_wheels_of_one_shaft_share_its_torque() -> None:
    it = shaft(wheels=2)
    for _ in range(400):
        it.tires[0].meet(0.0, 0.0, 100.0)
        it.tires[1].meet(0.0, 0.0, 0.0)
        it.turn(10.0, -4.0, 4.0)
        forces = [tire.settle(it.tread_mps)[0] for tire in it.tires]
    assert forces == pytest.approx([4.0 / RADIUS_M, 0.0], rel=1e-3)


def test_a_motor_that_is_too_weak_pulls_by_the_wheels_that_are_on_the_ground() -> None:
    it = shaft(wheels=5)
    forces = []
    for _ in range(400):
        for tire in it.tires[:3]:
            tire.meet(3.0, 0.0, 40.0)
        it.turn(100.0, -4.0, 4.0)
        forces.append(sum(tire.settle(it.tread_mps)[0] for tire in it.tires))
    assert forces[200:] == pytest.approx([4.0 / RADIUS_M] * 200, rel=1e-3)
