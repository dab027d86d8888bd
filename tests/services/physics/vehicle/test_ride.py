# SPDX-License-Identifier: Apache-2.0
"""Roughness, treads and engines shake a vehicle as its springs let them."""

from math import cos, tau

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.scenario.schema import Scenario, Vehicle, World
from groundlink.scenario.vehicle import Effect, Engine, EngineOrder, Tread, VehicleModel, Vibration
from groundlink.world.roughness import RoughGround
from groundlink.world.terrain import RoughnessClass
from services.physics.running_gear.running_gear import IN_AIR
from services.physics.simulation import simulation
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import FLOOR, MATERIALS, NAME, drive
from services.physics.vehicle.ride import FADE_S, EngineShake, WheelLift
from tests.services.physics.grounds import shipped

SPEED_MPS = 1.0


def put(
    model: VehicleModel,
    roughness: RoughnessClass | dict[str, RoughnessClass] | None = None,
    effects: tuple[Effect, ...] = (),
) -> Simulation:
    vehicle = Vehicle(name=NAME, model=model, effects=effects)
    world = World(name="level", materials=MATERIALS, roughness=roughness)
    return Simulation(Scenario(name="ride", world=world, vehicles=(vehicle,)), (FLOOR,))


def heave_mps2(simulation: Simulation, seconds: float = 2.0) -> NDArray[np.float64]:
    """Return the vertical acceleration of the base at a steady speed."""
    drive(simulation, 2.0, (SPEED_MPS, 0.0))
    moved = drive(simulation, seconds, (SPEED_MPS, 0.0))
    return np.diff(moved.velocity[:, 2]) / TICK_SECONDS


def test_a_lift_is_continuous_and_fades_to_the_ground() -> None:
    lift = WheelLift()
    assert lift.follow(1.0, 0.02) == 0.0
    lifts = []
    for _ in range(round(FADE_S / TICK_SECONDS)):
        lift.follow(1.0, 0.02)
        lifts.append(lift.lift_m)
    assert lifts[-1] == pytest.approx(0.02 * (1 - np.exp(-1)), rel=1e-6)
    lift.follow(IN_AIR, 0.0)
    assert lift.lift_m == pytest.approx(lifts[-1])
    lift.follow(4.0, 0.08)
    assert lift.lift_m == pytest.approx(lifts[-1])


def test_waves_reach_the_body_as_through_a_spring_and_a_damper(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Waves(RoughGround):
        """Waves that lift all wheels of the rover at once."""

        def __init__(self, seed: int) -> None:
            pass

        def height_m(self, x_m: float, y_m: float) -> float:
            return 0.001 * cos(tau * x_m / 0.256)

    monkeypatch.setattr(simulation, "RoughGround", Waves)
    model = shipped("rover")
    with put(model, "A") as rolling:
        drive(rolling, 2.0, (SPEED_MPS, 0.0))
        moved = drive(rolling, 2.048, (SPEED_MPS, 0.0))
    shaken = np.diff(moved.velocity[:, 2]) / TICK_SECONDS
    wave = np.exp(-1j * tau * moved.pose[1:, 0] / 0.256)
    omega = tau * SPEED_MPS / 0.256
    spring, mass = model.suspension, model.chassis.mass_kg / 4
    coupled = spring.stiffness_npm + 1j * omega * spring.damping_nspm
    expected = -0.001 * omega**2 * coupled / (coupled - mass * omega**2)
    answer = 2 * (shaken * wave).mean()
    assert abs(answer) == pytest.approx(abs(expected), rel=0.05)
    # A tick is 0.06 rad; contacts are those of the tick before.
    assert np.angle(answer / expected) == pytest.approx(0.0, abs=0.15)


def test_a_rougher_class_shakes_twice_as_much() -> None:
    model, deviations = shipped("rover"), []
    classes: tuple[RoughnessClass, ...] = ("A", "B")
    for roughness in classes:
        with put(model, roughness) as rolling:
            deviations.append(heave_mps2(rolling).std())
    assert deviations[0] > 0.05
    assert deviations[1] == pytest.approx(2 * deviations[0], rel=0.1)


def test_only_rough_materials_shake() -> None:
    with put(shipped("rover"), {"ice": "F"}) as rolling:
        assert heave_mps2(rolling, 1.0).std() < 0.01


def test_treads_shake_at_their_pitch_where_the_scenario_asks_for_it() -> None:
    model = replace(shipped("rover"), vibration=Vibration(tread=Tread(pitch_m=0.04, rise_m=0.001)))
    with put(model) as rolling:
        assert heave_mps2(rolling, 1.0).std() < 0.01
    with put(model, effects=("vibration",)) as rolling:
        shaken = heave_mps2(rolling)
    power = np.abs(np.fft.rfft(shaken)) ** 2
    assert np.argmax(power) * TICK_RATE_HZ / len(shaken) == pytest.approx(25.0, abs=0.5)
    assert shaken.std() > 0.2


def test_an_engine_shakes_in_its_orders() -> None:
    orders = (
        EngineOrder(order=1.0, acceleration_mps2=0.4),
        EngineOrder(order=6.0, acceleration_mps2=2.0),
    )
    engine = Engine(idle_rpm=600.0, max_rpm=1200.0, orders=orders)
    for speed_mps, turns_hz, share in ((0.0, 10.0, 0.25), (-5.0, 15.0, 0.5625), (20.0, 20.0, 1.0)):
        shake = EngineShake(engine, mass_kg=100.0, top_speed_mps=10.0)
        forces = np.array([shake.force_n(speed_mps) for _ in range(TICK_RATE_HZ)])
        amplitudes = np.abs(np.fft.rfft(forces)) * 2 / len(forces) / 100.0
        assert amplitudes[round(turns_hz)] == pytest.approx(0.4 * share, rel=0.01)
        assert amplitudes[round(6 * turns_hz)] == pytest.approx(2.0 * share, rel=0.01)
    too_fast = EngineShake(
        replace(engine, max_rpm=2000.0, orders=orders[1:]), mass_kg=100.0, top_speed_mps=10.0
    )
    assert {too_fast.force_n(10.0) for _ in range(10)} == {0.0}


def test_a_tank_with_its_engine_on_rough_ground_shakes_as_real_ones_do() -> None:
    with put(shipped("tank"), "E", ("vibration",)) as rolling:
        assert heave_mps2(rolling).std() > 0.4


def test_the_same_seed_shakes_alike_to_the_bit() -> None:
    paths = []
    for _ in range(2):
        with put(shipped("rover"), "E", ("vibration",)) as rolling:
            paths.append(drive(rolling, 0.5, (SPEED_MPS, 0.3)).pose.tobytes())
    assert paths[0] == paths[1]


def test_an_effect_needs_its_figures() -> None:
    with pytest.raises(ValueError, match="`effects`: model `car` has no `vibration`"):
        Vehicle(name="it", model=shipped("car"), effects=("vibration",))


def test_treads_that_shake_faster_than_ticks_are_refused_where_they_act() -> None:
    model = shipped("rover")
    model = replace(model, drive=replace(model.drive, max_wheel_speed_radps=60.0))
    Vehicle(name="it", model=model)
    with pytest.raises(ValueError, match="shakes faster than 150 Hz"):
        Vehicle(name="it", model=model, effects=("vibration",))
