# SPDX-License-Identifier: Apache-2.0
"""Actors meet vehicles, and each other, and are where they say."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import State, encode, floats
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scene.build import solids
from groundlink.world.actor_motion import mover
from groundlink.world.actors import (
    Actor,
    CrateForm,
    DoorForm,
    FreeMotion,
    HingeMotion,
    PartsForm,
    PathMotion,
    PersonForm,
    Swing,
)
from groundlink.world.solids import Box, Solid
from groundlink.world.terrain import load_ground
from services.physics.dynamics.backend import GRAVITY_MPS2, Backend
from services.physics.dynamics.bullet import BulletBackend
from services.physics.simulation.simulation import Simulation
from tests.services.physics.conftest import run
from tests.services.physics.free_bodies import FreeBodies
from tests.services.physics.grounds import shipped
from tests.services.physics.terrains import hills, terrain, world

Put = Callable[..., Simulation]

PERSON = PersonForm(shirt="plastic", trousers="cardboard", skin="plaster")
CRATE = Actor(
    name="crate",
    form=CrateForm(material="cardboard"),
    motion=FreeMotion(at_m=(1.5, 0.0, 0.0), mass_kg=8.0),
)
DOOR = Actor(
    name="gate",
    form=DoorForm(material="wood", width_m=1.4),
    # Across the rover's way, its hinge to the right; it opens away from the rover.
    motion=HingeMotion(
        at_m=(1.5, -0.7, 0.0), yaw_deg=90.0, swings=(Swing(at_s=5.5, angle_deg=-95.0),)
    ),
)


def poses(simulation: Simulation) -> NDArray[np.float64]:
    return floats(simulation.actor_poses()).reshape(-1, 7)


def touched(simulation: Simulation) -> set[str]:
    return {contact.name for told in simulation.vitals(0) for contact in told.contacts}


@pytest.fixture
def put(lab: Scenario) -> Iterator[Put]:
    """Return a function that starts the rover amid an empty room with actors before it."""
    started = []

    def begin(*actors: Actor, new_backend: Callable[[], Backend] = BulletBackend) -> Simulation:
        rover = replace(lab.vehicles[0], placement=Placement())
        world = replace(lab.world, actors=actors)
        scenario = replace(lab, vehicles=(rover,), world=world)
        floor = [solid for solid in solids(scenario) if solid.name == "room_floor"]
        started.append(Simulation(scenario, floor, new_backend=new_backend))
        return started[-1]

    yield begin
    for simulation in started:
        simulation.close()


def test_a_shut_door_stops_a_vehicle_and_an_open_one_lets_it_pass(put: Put) -> None:
    simulation = put(DOOR)
    before = run(simulation, 4.0, (0.5, 0.0))
    assert 0.7 < before.last[0] < 1.5 - 0.3
    assert touched(simulation) == {"gate"}
    run(simulation, 2.0, (-0.5, 0.0))
    after = run(simulation, 5.0, (0.5, 0.0))
    assert after.last[0] > 2.0


def test_a_crate_is_pushed_and_stops(put: Put) -> None:
    simulation = put(CRATE)
    run(simulation, 4.0, (0.5, 0.0))
    [(x, y, z, *_)] = poses(simulation)
    assert x > 1.7
    assert abs(y) < 0.05
    assert z == pytest.approx(0.0, abs=2e-3)
    assert touched(simulation) == {"crate"}
    run(simulation, 2.0, (-0.5, 0.0))
    rests = poses(simulation)
    run(simulation, 0.5)
    np.testing.assert_allclose(poses(simulation), rests, atol=1e-4)


@pytest.mark.parametrize("mass_kg", [2.0, 40.0])
def test_heavy_object_stops_a_colliding_vehicle(put: Put, mass_kg: float) -> None:
    motion = FreeMotion(at_m=(0.8, 0.0, 0.0), mass_kg=mass_kg, friction=0.3)
    simulation = put(replace(CRATE, motion=motion))
    speeds = run(simulation, 2.0, (1.0, 0.0)).velocity[:, 0]
    lost_mps = (np.maximum.accumulate(speeds) - speeds).max()
    assert (lost_mps < 0.1) == (mass_kg < 10)


@pytest.mark.parametrize("friction", [0.1, 0.5])
def test_friction_stops_sliding_objects(lab: Scenario, put: Put, friction: float) -> None:
    cart = PathMotion(points_m=((-1.0, 1.5), (0.0, 1.5)), speed_mps=1.5, pause_s=100.0)
    struck = FreeMotion(at_m=(-0.2, 1.5, 0.0), mass_kg=2.0, friction=friction)
    simulation = put(
        Actor(name="cart", form=CrateForm(material="metal"), motion=cart),
        replace(CRATE, motion=struck),
    )
    run(simulation, 4.0)
    deceleration = friction * lab.world.materials["linoleum"].friction * GRAVITY_MPS2
    slid_m = poses(simulation)[1, 0] - 0.4
    assert slid_m == pytest.approx(1.5**2 / 2 / deceleration, rel=0.05)


@pytest.mark.parametrize("restitution", [0.0, 0.7])
def test_falling_object_bounces_by_its_restitution(put: Put, restitution: float) -> None:
    motion = FreeMotion(at_m=(1.5, 0.0, 0.5), mass_kg=1.0, restitution=restitution)
    simulation = put(replace(CRATE, motion=motion))
    heights = []
    for _ in range(400):
        simulation.step()
        heights.append(poses(simulation)[0, 2])
    landed = int(np.argmax(np.array(heights) < 0.005))
    # 0.5 m take 0.32 s.
    assert landed * TICK_SECONDS == pytest.approx(0.32, abs=0.02)
    assert (max(heights[landed:]) > 0.1) == (restitution > 0)


def test_a_person_blocks_a_vehicle_and_gives_way_to_nothing(put: Put) -> None:
    motion = PathMotion(points_m=((3.0, 0.0), (-3.0, 0.0)), speed_mps=0.8)
    simulation = put(Actor(name="visitor", form=PERSON, motion=motion))
    trace = run(simulation, 3.5, (0.5, 0.0))
    assert "visitor" in touched(simulation)
    # Met half way and pushed back.
    assert trace.pose[:, 0].max() < 1.6
    assert trace.last[0] < trace.pose[:, 0].max() - 0.3
    assert trace.last[2] == pytest.approx(0.165, abs=0.1)


def test_moving_actor_follows_its_motion(put: Put) -> None:
    motion = PathMotion(points_m=((3.0, 0.0), (3.0, 2.0), (4.0, 2.0)), pause_s=0.2)
    visitor = Actor(name="visitor", form=PERSON, motion=motion)
    simulation = put(visitor, DOOR, new_backend=FreeBodies)
    movers = [mover(motion, None), mover(DOOR.motion, None)]  # type: ignore[arg-type]
    for _ in range(0, 3200, 40):
        for _ in range(40):
            simulation.step()
        for pose, made in zip(poses(simulation), movers, strict=True):
            place = made.at(simulation.tick * TICK_SECONDS)
            assert tuple(pose) == (*place.position_m, *place.orientation)


def test_a_walker_meets_a_crate(put: Put) -> None:
    motion = PathMotion(points_m=((3.0, 1.0), (5.0, 1.0)))
    crate = replace(CRATE, motion=FreeMotion(at_m=(4.0, 1.0, 0.0), mass_kg=8.0))
    simulation = put(Actor(name="visitor", form=PERSON, motion=motion), crate)
    run(simulation, 1.6)
    assert poses(simulation)[1, 0] > 4.3


def test_the_center_of_mass_is_amid_the_body(put: Put) -> None:
    # A plank whose frame is at one end falls flat when it stands, and does not turn otherwise.
    plank = Solid("plank", Box(size_m=(1.0, 0.2, 0.05)), "wood", (0.5, 0.0, 0.025))
    motion = FreeMotion(at_m=(1.0, 1.5, 0.3), mass_kg=3.0)
    simulation = put(Actor(name="plank", form=PartsForm(parts=(plank,)), motion=motion))
    run(simulation, 1.0)
    np.testing.assert_allclose(poses(simulation)[0], [1, 1.5, 0, 0, 0, 0, 1], atol=5e-3)


def test_crates_lie_on_terrain_and_people_walk_on_it() -> None:
    empty = world(terrain(hills(60)), (shipped("rover"), Placement(x_m=-20.0)))
    crate = Actor(
        name="crate",
        form=CrateForm(material="ground"),
        motion=FreeMotion(at_m=(8.0, 3.0, 0.3), mass_kg=8.0, friction=3.0),
    )
    walk = PathMotion(points_m=((10.0, -5.0), (10.0, 5.0)), speed_mps=2.0)
    person = PersonForm(shirt="ground", trousers="ground", skin="ground")
    walker = Actor(name="visitor", form=person, motion=walk)
    made = replace(empty, world=replace(empty.world, actors=(crate, walker)))
    assert made.world.terrain
    here = load_ground(made.world.terrain)
    with Simulation(made, solids(made)) as simulation:
        for _ in range(1000):
            simulation.step()
        for x, y, z, *_ in poses(simulation).tolist():
            assert z == pytest.approx(float(here.height_at(x, y)), abs=0.02)
        rests = poses(simulation)[0]
        for _ in range(200):
            simulation.step()
        np.testing.assert_allclose(poses(simulation)[0], rests, atol=2e-3)


def test_the_same_run_has_the_same_bytes(put: Put) -> None:
    walk = PathMotion(points_m=((1.0, -2.0), (1.0, 2.0)))
    begin = partial(put, Actor(name="visitor", form=PERSON, motion=walk), DOOR, CRATE)

    def payloads(simulation: Simulation) -> list[bytes]:
        told = []
        for tick in range(1200):
            run(simulation, TICK_SECONDS, (0.7, 0.1))
            states = simulation.vehicle_states()
            state = State("r", 0, 0, tick, 0, "", states, simulation.actor_poses())
            told.append(encode(state))
        return told

    assert payloads(begin()) == payloads(begin())


def test_a_run_without_meetings_is_as_if_there_were_no_actors(put: Put) -> None:
    far = replace(CRATE, motion=FreeMotion(at_m=(-4.0, 3.0, 0.0), mass_kg=5.0))
    alone, beside = put(), put(far)
    first, second = (run(simulation, 1.0, (0.5, 0.3)) for simulation in (alone, beside))
    np.testing.assert_allclose(first.pose, second.pose, atol=1e-6)
