# SPDX-License-Identifier: Apache-2.0
"""How the rover moves, by the truth that physics tells."""

from math import inf, nan, radians

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.frames import matrix_from_quaternion
from groundlink.messages.base import Command, State, encode
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement, Vehicle
from groundlink.scene.build import solids
from groundlink.world.objects.indoor_objects import build_furniture
from groundlink.world.objects.indoor_specs import Table
from services.physics.simulation.simulation import Simulation
from services.physics.trials.track import Drive
from tests.services.physics.conftest import ROVER, Start, run

CENTER = Placement(x_m=0.0)
RADIUS_M = 0.1651
FLOOR = ("room_floor",)


def vertical_noise(trace: Drive) -> tuple[float, float]:
    """Return the deviation of vertical acceleration, from velocity and from position, m/s^2."""
    return (
        np.diff(trace.velocity[:, 2]).std() / TICK_SECONDS,
        np.diff(trace.pose[:, 2], 2).std() / TICK_SECONDS**2,
    )


def test_stands_still_from_the_first_tick(start: Start) -> None:
    simulation = start()
    before = simulation.vehicle_states()[ROVER].poses()
    trace = run(simulation, 2.0)
    assert max(vertical_noise(trace)) < 0.005
    assert np.abs(trace.velocity).max() < 1e-3
    np.testing.assert_allclose(trace.last, before[0], atol=1e-5)
    np.testing.assert_allclose(before[0], [-4.6, 0, RADIUS_M, 0, 0, 0, 1], atol=1e-9)


def test_all_four_wheels_carry_alike(start: Start) -> None:
    trace = run(start(), 1.0)
    # Springs of 8000 N/m: 0.1 mm is less than 1 % of what a wheel carries.
    np.testing.assert_allclose(trace.wheels[-1, :, 2], RADIUS_M, atol=1e-4)
    np.testing.assert_allclose(trace.last[2], RADIUS_M, atol=1e-4)


@pytest.mark.parametrize("speed", [0.5, 1.0, -0.5, -1.0])
def test_drives_at_the_commanded_speed(start: Start, speed: float) -> None:
    simulation = start(CENTER)
    first = run(simulation, 2.0, (speed, 0.0))
    steady = run(simulation, 1.0, (speed, 0.0))
    assert steady.velocity[:, 0].mean() == pytest.approx(speed, rel=0.01)
    assert max(vertical_noise(steady)) < 0.05
    driven = steady.last[0]
    assert steady.angles[-1] * RADIUS_M == pytest.approx(np.full(4, driven), rel=0.01)
    assert driven == pytest.approx(speed * 3.0, rel=0.15)
    assert abs(steady.last[1]) < 0.005
    assert np.abs(first.pose[:, 4]).max() < radians(3), "pitches hard"


@pytest.mark.parametrize("heading_deg", [0.0, 45.0, 90.0])
@pytest.mark.parametrize("rate", [0.5, 1.0, -1.0])
def test_turns_at_the_commanded_rate_on_every_heading(
    start: Start, rate: float, heading_deg: float
) -> None:
    simulation = start(Placement(x_m=0.0, yaw_deg=heading_deg), only=FLOOR)
    run(simulation, 1.0, (0.0, rate))
    steady = run(simulation, 2.0, (0.0, rate))
    np.testing.assert_allclose(steady.velocity[:, 5], rate, rtol=0.02)
    assert max(vertical_noise(steady)) < 0.05
    assert np.abs(steady.last[:2]).max() < 0.02, "wanders off"


def test_drives_a_curve(start: Start) -> None:
    simulation = start(CENTER, only=FLOOR)
    run(simulation, 2.0, (0.5, 0.5))
    steady = run(simulation, 2.0, (0.5, 0.5))
    assert steady.velocity[:, 5].mean() == pytest.approx(0.5, rel=0.05)
    assert np.hypot(*steady.velocity[:, :2].T).mean() == pytest.approx(0.5, rel=0.05)


def test_moves_alike_on_every_heading(start: Start) -> None:
    traces = []
    for heading_deg in (0.0, 70.0):
        simulation = start(Placement(x_m=0.0, yaw_deg=heading_deg), only=FLOOR)
        trace = run(simulation, 1.0, (0.8, 0.6))
        c, s = np.cos(radians(heading_deg)), np.sin(radians(heading_deg))
        start_from_world = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        traces.append(
            (trace.pose[:, :3] @ start_from_world.T, trace.velocity[:, :3] @ start_from_world.T)
        )
    np.testing.assert_allclose(traces[0], traces[1], atol=1e-9)


def test_velocity_is_that_of_the_base_origin(start: Start) -> None:
    # The wheels' torque pitches the body about its center of mass, which is not the origin.
    trace = run(start(CENTER), 0.5, (1.0, 0.5))
    moved = np.diff(trace.pose[:, :3], axis=0) / TICK_SECONDS
    np.testing.assert_allclose(moved, trace.velocity[1:, :3], atol=2e-4)


def test_links_are_where_base_and_joints_put_them(lab: Scenario, start: Start) -> None:
    trace = run(start(CENTER), 1.0, (0.8, 0.6))
    world_from_base = matrix_from_quaternion(trace.last[3:])
    for index, wheel in enumerate(lab.vehicles[0].model.wheels):
        pose, angle = trace.wheels[-1, index], trace.angles[-1, index]
        in_base = world_from_base.T @ (pose[:3] - trace.last[:3])
        np.testing.assert_allclose(in_base[:2], wheel.center_m[:2], atol=1e-9)
        assert abs(in_base[2]) < 0.01
        c, s = np.cos(angle), np.sin(angle)
        base_from_wheel = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        np.testing.assert_allclose(
            matrix_from_quaternion(pose[3:]), world_from_base @ base_from_wheel, atol=1e-9
        )


def test_stops_when_commands_cease(start: Start) -> None:
    simulation = start(CENTER)
    run(simulation, 1.0, (0.5, 0.0))
    coasting = run(simulation, 1.0)
    assert coasting.velocity[195, 0] == pytest.approx(0.5, rel=0.02), "stopped before 0.5 s"
    assert np.abs(coasting.velocity[360:, 0]).max() < 0.02
    assert np.abs(run(simulation, 1.0).velocity[-1]).max() < 1e-4


def test_speeds_are_clipped(lab: Scenario, start: Start) -> None:
    simulation = start(Placement(x_m=-4.0), only=FLOOR)
    trace = run(simulation, 2.0, (100.0, 0.0))
    limit = lab.vehicles[0].model.drive.max_wheel_speed_radps * RADIUS_M
    assert trace.velocity[-1, 0] == pytest.approx(limit, rel=0.01)


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_refuses_values_that_are_not_finite(start: Start, value: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        start().command(ROVER, Command(0, (0.0, value, 0.0), (0.0, 0.0, 0.0)))


def test_refuses_a_vehicle_that_is_not_there(start: Start) -> None:
    with pytest.raises(KeyError):
        start().command("rovr", Command(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))


def test_a_wall_stops_it(start: Start) -> None:
    # The west wall's inner face is at x = -6, the chassis is 0.99 m long.
    simulation = start(Placement(x_m=-4.0, y_m=0.9), only=("room", "wall"))
    trace = run(simulation, 4.0, (-1.0, 0.0))
    assert trace.pose[:, 0].min() > -6.0 + 0.99 / 2 - 0.01
    assert trace.last[0] < -5.0
    assert np.abs(trace.velocity[-1, :3]).max() < 0.02
    assert np.abs(trace.pose[:, 3:5]).max() < radians(5), "tips over"
    assert np.abs(trace.pose[:, 2] - RADIUS_M).max() < 0.02, "sinks or climbs"


def test_a_table_stops_its_mast(start: Start) -> None:
    # Crosswise, wide enough for the rover to pass between its legs: its near edge is at x = 1.4.
    table, _ = build_furniture(0, Table(at_m=(1.8, 0.0), yaw_deg=90.0))
    simulation = start(Placement(x_m=1.0), extra=tuple(table), only=FLOOR)
    trace = run(simulation, 4.0, (0.2, 0.0))
    assert 1.3 < trace.pose[:, 0].max() < 1.42
    assert abs(trace.velocity[-1, 0]) < 0.01


def test_leaves_the_room_by_the_door(start: Start) -> None:
    trace = run(start(Placement(x_m=4.6, y_m=-2.6, yaw_deg=-90.0)), 4.0, (0.8, 0.0))
    assert trace.last[1] < -5.0
    assert abs(trace.last[0] - 4.6) < 0.05


def test_survives_a_fall(start: Start) -> None:
    trace = run(start(Placement(x_m=0.0, z_m=0.5)), 3.0)
    np.testing.assert_allclose(trace.last, [0, 0, RADIUS_M, 0, 0, 0, 1], atol=1e-3)
    assert trace.pose[:, 2].min() > 0.05


def test_nothing_brakes_a_fall(start: Start) -> None:
    trace = run(start(CENTER, only=("nothing",)), 3.0)
    assert trace.velocity[-1, 2] == pytest.approx(-9.80665 * 3.0, rel=0.005)


def test_same_calls_give_the_same_bytes(lab: Scenario) -> None:
    other = replace(lab.vehicles[0], name="second", placement=Placement(x_m=-1.0, y_m=0.4))
    scenario = replace(lab, vehicles=(lab.vehicles[0], other))
    assert record(scenario) == record(scenario)


def record(scenario: Scenario) -> list[bytes]:
    """Return the states of 1000 ticks in which two rovers drive, turn and meet."""
    payloads = []
    with Simulation(scenario, solids(scenario)) as simulation:
        for tick in range(1000):
            if tick % 20 == 0:
                for sign, name in enumerate(simulation.vehicle_states()):
                    twist = (1.0 - 1.8 * sign, 0.3 * np.sin(tick / 50))
                    stamp = simulation.sim_nanos
                    simulation.command(name, Command(stamp, (twist[0], 0, 0), (0, 0, twist[1])))
            simulation.step()
            states = simulation.vehicle_states()
            payloads.append(encode(State("r", 0, 0, tick, simulation.sim_nanos, "", states)))
    return payloads


def test_vehicles_do_not_pass_through_each_other(lab: Scenario) -> None:
    other: Vehicle = replace(lab.vehicles[0], name="second", placement=Placement(x_m=-2.6))
    scenario = replace(lab, vehicles=(lab.vehicles[0], other))
    with Simulation(scenario, solids(scenario)) as simulation:
        run(simulation, 4.0, (0.5, 0.0))
        first, second = (s.poses()[0] for s in simulation.vehicle_states().values())
    assert second[0] - first[0] > 0.98
    assert second[0] > -2.6 + 0.1, "was not pushed"
