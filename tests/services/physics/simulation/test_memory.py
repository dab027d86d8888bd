# SPDX-License-Identifier: Apache-2.0
"""A simulation's memory has all of its inner state."""

import ctypes
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.loader import load
from groundlink.messages.base import Command, packed
from groundlink.messages.navigation import JointState
from groundlink.scenario import Scenario
from groundlink.scenario.running_gear import Battery
from groundlink.scenario.vehicle import EFFECTS, Effect, VehicleModel
from groundlink.scene.build import solids
from groundlink.world.actors import Actor, CrateForm, FreeMotion
from services.physics.simulation.simulation import Simulation, SimulationMemory

DERIVED = frozenset(
    (
        # Read from the engine after every step.
        *("_origin", "_velocity", "_rows"),
        # Addresses.
        *("_link_poses", "_base_velocity", "_joint_positions", "_joint_velocities"),
        *("_servo_positions", "_servo_velocities"),
        # Consumed by the memory; they are in it under other names.
        *("_keeps_contacts", "_touches", "_grip_n", "_normal_n", "_named", "under"),
        # Set in each tick before it is used.
        *("_asked", "asked_radps", "asked_nm", "asked_rad"),
        *("shake_n", "raised_m", "raised_mps", "_scratch", "_taken"),
        # Where a window of terrain lies follows from where its body is.
        *("_x_m", "_y_m", "_friction"),
    )
)
"""Attributes that need not be the same."""

INSPECTED = tuple(f"services.physics.{part}" for part in ("vehicle", "running_gear", "simulation"))

Path = tuple[str, ...]


def inner_state(
    thing: object, path: Path = (), seen: set[int] | None = None
) -> Iterator[tuple[Path, object]]:
    """Yield the plain values of a simulation's parts, by where they are."""
    seen = set() if seen is None else seen
    if id(thing) in seen:
        return
    seen.add(id(thing))
    if isinstance(thing, list | tuple):
        for i, each in enumerate(thing):
            yield from inner_state(each, (*path, str(i)), seen)
    elif isinstance(thing, dict):
        for key, each in thing.items():
            yield from inner_state(each, (*path, str(key)), seen)
    elif type(thing).__module__.startswith(INSPECTED):
        slots = {s for base in type(thing).__mro__ for s in getattr(base, "__slots__", ())}
        slots |= {name for name, *_ in getattr(type(thing), "_fields_", ())}
        for name in sorted({*slots, *getattr(thing, "__dict__", ())} - DERIVED):
            value = getattr(thing, name)
            if isinstance(value, ctypes.Array):
                value = list(value)
            if isinstance(value, int | float | tuple | list | dict) and is_plain(value):
                yield (*path, name), value
            else:
                yield from inner_state(value, (*path, name), seen)


def is_plain(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(map(is_plain, value))
    if isinstance(value, dict):
        return all(map(is_plain, value.values()))
    return isinstance(value, int | float | str | None)


def scenario_of(name: str) -> Scenario:
    """Return a shipped scenario whose vehicle has a battery and all effects, and a crate."""
    scenario = load(name)
    [vehicle, *_] = scenario.vehicles
    battery = Battery(capacity_ah=2.0, full_v=25.0, empty_v=20.0, resistance_ohm=0.1)
    model = replace(vehicle.model, battery=battery)
    crate = Actor(
        name="crate",
        form=CrateForm(material="plaster"),
        # It falls, and turns where it lands.
        motion=FreeMotion(at_m=(3.0, 3.0, 0.5), yaw_deg=20.0, mass_kg=8.0),
    )
    world = replace(scenario.world, actors=(crate,))
    vehicle = replace(vehicle, model=model, effects=effects_of(model))
    return replace(scenario, vehicles=(vehicle,), world=world)


def effects_of(model: VehicleModel) -> tuple[Effect, ...]:
    """Return all effects that a model has."""
    return tuple(name for name in EFFECTS if getattr(model, name) is not None)


@pytest.mark.parametrize("name", ["indoor_lab", "indoor_paper", "outdoor_paper"])
def test_nothing_is_forgotten(name: str) -> None:
    scenario = scenario_of(name)
    [vehicle] = scenario.vehicles
    with Simulation(scenario, solids(scenario)) as simulation:
        for tick in range(60):
            if tick % 8 == 0:
                stamp = (tick + 9) * TICK_NANOS
                command = Command(stamp, (1.0, 0.0, 0.0), (0.0, 0.0, 0.5))
                simulation.command(vehicle.name, command)
            simulation.step()
        servos = [joint.name for joint in vehicle.model.joints]
        if servos:
            asked = packed(np.full(len(servos), 0.2))
            simulation.command(
                vehicle.name,
                JointState(
                    70 * TICK_NANOS, "", tuple(servos), asked, memoryview(b""), memoryview(b"")
                ),
            )
        if vehicle.model.bumper:
            # As where the chassis touches a wall.
            simulation._vehicles[vehicle.name]._share_bumper(vehicle.model.bumper, 3)
        before, motions = dict(inner_state(simulation)), simulation.motions()
        content = msgspec.msgpack.encode(simulation.memory())
        memory = msgspec.msgpack.decode(content, type=SimulationMemory)
        with Simulation(scenario, solids(scenario), memory=memory) as again:
            after = dict(inner_state(again))
            assert after == before
            for name, motion in again.motions().items():
                for now, then in zip(motion, motions[name], strict=True):
                    np.testing.assert_allclose(
                        np.concatenate(now), np.concatenate(then), atol=1e-12
                    )
        assert len(before) > 50


def test_commands_that_a_journal_has_are_left_out() -> None:
    scenario = scenario_of("indoor_lab")
    [vehicle] = scenario.vehicles
    with Simulation(scenario, solids(scenario)) as simulation:
        simulation.step()
        for tick in (0, 1, 5):
            command = Command(tick * TICK_NANOS, (0.1, 0.0, 0.0), (0.0, 0.0, 0.0))
            simulation.command(vehicle.name, command)
        memory = simulation.memory()
    kept = memory.stamped_before_tick().vehicles[vehicle.name].drive.waiting
    assert [stamp for stamp, _ in memory.vehicles[vehicle.name].drive.waiting] == [
        *(0, TICK_NANOS, 5 * TICK_NANOS)
    ]
    assert [stamp for stamp, _ in kept] == [0]
