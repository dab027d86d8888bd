# SPDX-License-Identifier: Apache-2.0
"""A trailer behind a car: its circle, jackknifing, hitches over changes, and refusals."""

from math import atan2, degrees, exp, hypot, radians, sqrt, tan
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.messages.base import Command, VehicleState, floats
from groundlink.scenario.schema import Placement, Scenario, Vehicle, World
from groundlink.scenario.vehicle import Towing
from services.physics.simulation.simulation import Simulation, SimulationMemory
from services.physics.trials.track import FLOOR, MATERIALS, NAME, drive
from tests.services.physics.grounds import TRAILER, shipped

HITCH, COUPLING = (-2.13, 0.0, 0.114), (2.3, 0.0, 0.15)
LENGTH_M = COUPLING[0]


def scenario(angle_deg: float = 0.0, at: Placement | None = None) -> Scenario:
    car = Vehicle(name=NAME, model=shipped("car"), placement=at or Placement())
    towing = Towing(vehicle=NAME, hitch_m=HITCH, coupling_m=COUPLING, angle_deg=angle_deg)
    trailer = Vehicle(name=TRAILER, model=shipped(TRAILER), towed_by=towing)
    world = World(name="track", materials={**MATERIALS})
    return Scenario(name="track", world=world, vehicles=(car, trailer))


def hitched(angle_deg: float = 0.0, memory: SimulationMemory | None = None) -> Simulation:
    return Simulation(scenario(angle_deg), (FLOOR,), memory=memory)


def yaw(state: VehicleState) -> float:
    *_, z, w = state.poses()[0].tolist()
    return 2 * atan2(z, w)


def apart_m(simulation: Simulation) -> float:
    """Return the distance of hitch and coupling."""
    states = simulation.vehicle_states()
    ends = []
    for name, at in ((NAME, HITCH), (TRAILER, COUPLING)):
        x, y = states[name].poses()[0, :2].tolist()
        c, s = np.cos(yaw(states[name])), np.sin(yaw(states[name]))
        ends.append((x + c * at[0] - s * at[1], y + s * at[0] + c * at[1]))
    return float(np.linalg.norm(np.subtract(*ends)))


def test_its_placement_follows_from_the_hitch() -> None:
    at = Placement(10.0, 5.0, 0.0, 90.0)
    place = scenario(at=at).vehicles[1].placement
    assert (place.x_m, place.y_m) == pytest.approx((10.0, 5.0 - 2.13 - 2.3))
    assert place.yaw_deg == 90.0
    turned = scenario(90.0).vehicles[1].placement
    assert (turned.x_m, turned.y_m) == pytest.approx((-2.13, -2.3))
    assert scenario(90.0) == replace(scenario(90.0))


def test_it_cuts_the_corner_by_the_closed_form() -> None:
    """R_trailer = sqrt(R_hitch^2 - L^2), with the hitch behind the car's rear axle."""
    car, radius_m = shipped("car"), 7.0
    axle_m = car.drive.pivot_x_m(car.wheels)
    with hitched() as simulation:
        drive(simulation, 14.0, (1.5, 1.5 / radius_m))
        states = simulation.vehicle_states()
        assert apart_m(simulation) < 2e-3
    vx, vy, *_, rate = floats(states[NAME].base_velocity).tolist()
    c, s = np.cos(yaw(states[NAME])), np.sin(yaw(states[NAME]))
    car_m = hypot(vx - rate * s * axle_m, vy + rate * c * axle_m) / rate
    vx, vy, *_, rate = floats(states[TRAILER].base_velocity).tolist()
    assert car_m == pytest.approx(radius_m, rel=0.01)
    expected = sqrt(car_m**2 + (axle_m - HITCH[0]) ** 2 - LENGTH_M**2)
    assert hypot(vx, vy) / rate == pytest.approx(expected, rel=2e-3)


def test_it_jackknifes_in_reverse_and_straightens_ahead() -> None:
    """The tangent of half the angle grows, or falls, with the way over the length."""
    for speed, seconds in ((-0.5, 6.0), (0.5, 6.0)):
        with hitched(6.0) as simulation:
            drive(simulation, 1.0, (speed, 0.0))
            angles, ways = [], []
            for _ in range(2):
                states = simulation.vehicle_states()
                angles.append(yaw(states[TRAILER]) - yaw(states[NAME]))
                ways.append(states[NAME].poses()[0, 0])
                drive(simulation, seconds - 1.0, (speed, 0.0))
        grown = exp(-(ways[1] - ways[0]) / LENGTH_M)
        found = tan(angles[1] / 2) / tan(angles[0] / 2)
        assert found == pytest.approx(grown, rel=0.03)
        assert (abs(degrees(angles[1])) > 15.0) is (speed < 0.0)


def test_the_car_pulls_it_up_to_speed_and_its_brakes_stop_both() -> None:
    with hitched() as simulation:
        fast = drive(simulation, 5.0, (5.0, 0.0))
        assert fast.speed == pytest.approx(5.0, rel=0.01)
        drive(simulation, 5.0, (0.0, 0.0))
        states = simulation.vehicle_states()
        assert apart_m(simulation) < 2e-3
    for state in states.values():
        assert np.abs(floats(state.base_velocity)).max() < 0.02


def test_a_checkpoint_and_a_reset_keep_the_hitch() -> None:
    with hitched() as simulation:
        drive(simulation, 2.0, (2.0, 0.3))
        memory = simulation.memory()
        simulation.continue_from(memory, scenario())
        first = drive(simulation, 1.0, (2.0, 0.3))
    with hitched(memory=memory) as simulation:
        assert np.array_equal(drive(simulation, 1.0, (2.0, 0.3)).pose, first.pose)
        simulation.reset_state(scenario())
        drive(simulation, 1.0, (2.0, 0.3))
        assert apart_m(simulation) < 2e-3


def test_a_car_whose_trailer_is_removed_drives_on_and_back() -> None:
    whole = scenario()
    with hitched() as simulation:
        drive(simulation, 1.0, (1.0, 0.0))
        simulation.become(replace(whole, vehicles=whole.vehicles[:1]), (FLOOR,))
        drive(simulation, 1.0, (1.0, 0.0))
    with hitched() as simulation:
        simulation.become(replace(whole, vehicles=whole.vehicles[1:]), (FLOOR,))
        simulation.command(TRAILER, Command(0, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        moved = drive(simulation, 1.0, name=TRAILER)
    assert abs(moved.last[0] - moved.pose[0, 0]) < 0.3


TRAIN = """
name: train
world:
  name: field
  solids:
    - name: floor
      shape: {{kind: box, size_m: [60, 60, 1]}}
      material: concrete
      position_m: [0, 0, -0.5]
      drivable: true
vehicles:
  - {{name: car, model: car}}
  - name: trailer
    model: trailer
    towed_by: {{vehicle: {by}, hitch_m: [-2.13, 0, {z}], coupling_m: [2.3, 0, 0.15]}}
"""


def test_a_scenario_has_a_car_with_a_trailer(tmp_path: Path) -> None:
    file = tmp_path / "train.yaml"
    file.write_text(TRAIN.format(by="car", z=0.114))
    found = load(file)
    assert found.vehicles[1].placement.x_m == pytest.approx(-4.43)
    assert radians(found.vehicles[1].placement.yaw_deg) == 0.0


@pytest.mark.parametrize(
    ("by", "z", "match"),
    [
        ("tractor", 0.114, r"no earlier vehicle `tractor`; expected one of car"),
        ("car", 0.3, r"is 0.43 m above level ground, the hitch 0.616 m; expected the same height"),
    ],
)
def test_hitches_that_do_not_fit_are_refused(tmp_path: Path, by: str, z: float, match: str) -> None:
    file = tmp_path / "train.yaml"
    file.write_text(TRAIN.format(by=by, z=z))
    with pytest.raises(UserError, match=match):
        load(file)
