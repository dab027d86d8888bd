# SPDX-License-Identifier: Apache-2.0
"""Energy adds up, contacts have names, and neither changes the motion."""

import pytest

from groundlink.messages.ground_truth import Vitals
from groundlink.scenario.schema import Placement
from groundlink.world.solids import Box, Cylinder, Solid, Sphere
from services.physics.dynamics.chassis_contacts import ChassisContacts
from services.physics.simulation.simulation import Simulation
from tests.services.physics.conftest import ROVER, Start, run

CENTER = Placement(x_m=0.0)
FLOOR = ("room_floor",)
MASS_KG = 55.0


def vitals(simulation: Simulation) -> Vitals:
    [found] = simulation.vitals(simulation.sim_nanos)
    return found


def test_standing_still_takes_no_work(start: Start) -> None:
    simulation = start(CENTER)
    run(simulation, 2.0)
    found = vitals(simulation)
    assert (found.vehicle, found.tick) == (ROVER, 800)
    assert found.motor_work_j < 0.01
    assert found.contacts == ()


def test_the_work_is_the_kinetic_energy_and_braking_takes_it_back(start: Start) -> None:
    simulation = start(CENTER, only=FLOOR)
    fast = run(simulation, 2.0, (1.0, 0.0))
    speeding = vitals(simulation)
    speed = fast.velocity[-1, 0]
    rims = sum(wheel.mass_kg * 0.7 / 2 for wheel in simulation_wheels(simulation))
    kinetic = (MASS_KG + rims) * speed**2 / 2
    assert speeding.motor_work_j - speeding.braked_j == pytest.approx(kinetic, rel=0.08)
    run(simulation, 2.0, (0.0, 0.0))
    stopped = vitals(simulation)
    assert stopped.braked_j - speeding.braked_j == pytest.approx(kinetic, rel=0.08)
    assert stopped.motor_work_j >= stopped.braked_j, "energy from nowhere"


def simulation_wheels(simulation: Simulation) -> tuple:  # type: ignore[type-arg]
    return simulation._vehicles[ROVER]._model.wheels


def test_turning_on_the_spot_costs_more_than_it_gives_back(start: Start) -> None:
    simulation = start(CENTER, only=FLOOR)
    run(simulation, 2.0, (0.0, 1.0))
    found = vitals(simulation)
    assert found.motor_work_j > 50.0
    assert found.braked_j < 0.1 * found.motor_work_j


def test_an_obstacle_is_a_contact_by_its_name_and_the_floor_is_none(start: Start) -> None:
    near = Solid("crate", Box(size_m=(0.3, 0.3, 0.6)), "wood", (0.95, 0.1, 0.3))
    beside = Solid("post", Cylinder(radius_m=0.05, length_m=0.6), "wood", (0.95, 0.6, 0.3))
    simulation = start(CENTER, extra=(near, beside))
    run(simulation, 0.2)
    assert vitals(simulation).contacts == ()
    run(simulation, 2.0, (0.5, 0.0))
    first = vitals(simulation)
    [contact] = first.contacts
    assert contact.name == "crate"
    assert contact.force_n > 100.0
    assert 80 < contact.tick < first.tick
    assert 1 < contact.ticks < 800
    run(simulation, 2.0, (-0.5, 0.0))
    vitals(simulation)
    run(simulation, 0.5, (-0.5, 0.0))
    assert vitals(simulation).contacts == (), "told again"


def test_what_is_told_changes_no_motion(start: Start) -> None:
    near = Solid("crate", Box(size_m=(0.3, 0.3, 0.6)), "wood", (0.95, 0.1, 0.3))
    told, untold = start(CENTER, extra=(near,)), start(CENTER, extra=(near,))
    for _ in range(10):
        run(told, 0.2, (0.5, 0.1))
        run(untold, 0.2, (0.5, 0.1))
        vitals(told)
    ours, theirs = (it.vehicle_states()[ROVER] for it in (told, untold))
    assert bytes(ours.link_poses) == bytes(theirs.link_poses)


NAMED = [
    Solid("box", Box(size_m=(1.0, 1.0, 1.0)), "m"),
    Solid("can", Cylinder(radius_m=0.5, length_m=1.0), "m", (2.0, 0.0, 0.0)),
    Solid("ball", Sphere(radius_m=0.5), "m", (4.0, 0.0, 0.0)),
    # Its length lies along the world's y.
    Solid("bar", Box(size_m=(0.2, 4.0, 0.2)), "m", (6.0, 0.0, 0.0)),
    Solid("turned", Box(size_m=(4.0, 0.2, 0.2)), "m", (7.0, 0, 0), (0, 0, 0.5**0.5, 0.5**0.5)),
]


@pytest.mark.parametrize(
    ("point", "name"),
    [
        ((0.5, 0.4, 0.4), "box"),
        ((1.51, 0.0, 0.3), "can"),
        ((2.0, 0.1, 0.51), "can"),
        ((4.0, 0.35, 0.36), "ball"),
        ((6.1, 1.9, 0.0), "bar"),
        ((6.9, -1.9, 0.0), "turned"),
        ((0.45, 0.0, 0.0), "box"),
    ],
)
def test_a_point_belongs_to_the_solid_whose_surface_is_nearest(
    point: tuple[float, float, float], name: str
) -> None:
    contacts = ChassisContacts()
    contacts.touched((7, 3, point, 12.0))
    [contact] = contacts.report({3: NAMED})
    assert (contact.name, contact.force_n, contact.tick, contact.ticks) == (name, 12.0, 7, 1)


def test_largest_force_is_reported_with_its_tick() -> None:
    contacts = ChassisContacts()
    for tick, force in ((4, 1.0), (5, 3.0), (5, 2.0), (6, 2.0)):
        contacts.touched((tick, 1, (0.5, 0.0, 0.0), force))
    [contact] = contacts.report({1: NAMED[:1]})
    assert (contact.force_n, contact.tick, contact.ticks) == (3.0, 5, 3)
    assert contacts.report({1: NAMED[:1]}) == ()
