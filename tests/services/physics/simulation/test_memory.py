# SPDX-License-Identifier: Apache-2.0
"""A simulation's memory has all of its inner state."""

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
from groundlink.scene.build import solids
from services.physics.simulation.simulation import Simulation, SimulationMemory

DERIVED = frozenset(
    (
        # Read from the engine after every step.
        *("_origin", "_velocity", "_turn", "_quaternion", "_rows", "_sprung"),
        # Consumed by the memory; they are in it under other names.
        *("_first_contacts", "_touches", "_named", "under"),
        # Where a window of terrain lies follows from where its body is.
        *("_x_m", "_y_m", "_friction"),
    )
)
"""Attributes that need not be the same."""

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
    elif type(thing).__module__.startswith(("services.physics.vehicle", "services.physics.sim")):
        slots = {s for base in type(thing).__mro__ for s in getattr(base, "__slots__", ())}
        for name in sorted({*slots, *getattr(thing, "__dict__", ())} - DERIVED):
            value = getattr(thing, name)
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
    """Return a shipped scenario whose vehicle has a battery."""
    scenario = load(name)
    [vehicle, *_] = scenario.vehicles
    battery = Battery(capacity_ah=2.0, full_v=25.0, empty_v=20.0, resistance_ohm=0.1)
    model = replace(vehicle.model, battery=battery)
    return replace(scenario, vehicles=(replace(vehicle, model=model),))


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
        before = dict(inner_state(simulation))
        content = msgspec.msgpack.encode(simulation.memory())
        memory = msgspec.msgpack.decode(content, type=SimulationMemory)
        with Simulation(scenario, solids(scenario), memory=memory) as again:
            after = dict(inner_state(again))
            assert after == before
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
