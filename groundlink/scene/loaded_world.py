# SPDX-License-Identifier: Apache-2.0
"""Loaded worlds: the vehicles of a run in another world than that of its start, or in none.

The functions are pure. Vehicles with their sensors, the seed and all other settings stay those of
the run, since its processes and topics are made for them.
"""

import hashlib
from collections.abc import Mapping

import msgspec
from msgspec.structs import replace

from groundlink.scenario.schema import Scenario, World
from groundlink.world.solids import Box, Material, Solid

from .build import material_uses, world_hash

_CANONICAL = msgspec.msgpack.Encoder(order="deterministic")

_NO_WORLD = "no_world"
_GROUND = Solid("no_world_ground", Box(size_m=(10.0, 10.0, 1.0)), _NO_WORLD, (0.0, 0.0, -0.5))
"""Only solid of a run without a world: sensors and maps need something to measure."""


def with_world(run: Scenario, loaded: Scenario) -> Scenario:
    """Return a run's scenario in the world of another one.

    Its vehicles start where those of the other scenario start, in their order, and further ones at
    their own starts. A material of the world takes precedence over a vehicle's of the same name.

    Parameters
    ----------
    run
        scenario with which the run was started.
    loaded
        a scenario, or a world without vehicles.
    """
    starts = [vehicle.placement for vehicle in loaded.vehicles]
    starts += [vehicle.placement for vehicle in run.vehicles[len(starts) :]]
    vehicles = tuple(
        replace(vehicle, placement=start)
        for vehicle, start in zip(run.vehicles, starts, strict=False)
    )
    world = loaded.world
    absent = {v.name for v in loaded.vehicles} - {v.name for v in vehicles}
    entities = {name: told for name, told in world.entities.items() if name not in absent}
    materials = _vehicle_materials(run) | world.materials
    return replace(
        run,
        description=loaded.description,
        vehicles=vehicles,
        world=replace(world, entities=entities, materials=materials),
    )


def without_world(run: Scenario) -> Scenario:
    """Return a run's scenario without a world: see `has_world`."""
    materials = _vehicle_materials(run) | {_NO_WORLD: Material()}
    datum = run.world.datum
    world = World(name=_NO_WORLD, datum=datum, materials=materials, solids=(_GROUND,))
    return replace(run, description="", world=world)


def has_world(scenario: Scenario) -> bool:
    """Return whether a run with this scenario has a world.

    Without one, the vehicles are kept for the next world, and time stands still.
    """
    return (scenario.world.name, scenario.world.solids) != (_NO_WORLD, (_GROUND,))


def distinct(scenario: Scenario, known: Mapping[str, Scenario]) -> Scenario:
    """Return a scenario whose hash differs from those of other worlds of the run.

    The hash covers bodies and materials only, and sensors renew themselves when it changes. A world
    that differs in weather, light, position on Earth or descriptions alone gets an unused material.

    Parameters
    ----------
    known
        scenarios of all worlds of the run, by their hashes.
    """
    other = known.get(world_hash(scenario))
    if other is None or _surroundings(other.world) == _surroundings(scenario.world):
        return scenario
    digest = hashlib.sha256(_CANONICAL.encode(_surroundings(scenario.world))).hexdigest()
    materials = scenario.world.materials | {f"world_{digest[:12]}": Material()}
    return replace(scenario, world=replace(scenario.world, materials=materials))


def is_other_world(one: Scenario, other: Scenario) -> bool:
    """Return whether two scenarios are of different worlds, whatever was added or removed."""
    return _as_loaded(one.world) != _as_loaded(other.world)


def in_present_world(known: Scenario, present: Scenario) -> Scenario:
    """Return a scenario as a process knows it with the present world and starts of the run."""
    starts = {vehicle.name: vehicle.placement for vehicle in present.vehicles}
    vehicles = tuple(
        replace(vehicle, placement=starts.get(vehicle.name, vehicle.placement))
        for vehicle in known.vehicles
    )
    return replace(known, description=present.description, vehicles=vehicles, world=present.world)


def _vehicle_materials(run: Scenario) -> dict[str, Material]:
    """Return the materials of a run's vehicles; what they do not define is as the run has it."""
    used = {name for path, name in material_uses(run) if path[0] == "vehicles"}
    found = {name: run.world.materials[name] for name in sorted(used)}
    for vehicle in run.vehicles:
        found |= vehicle.model.materials
    return found


def _surroundings(world: World) -> tuple[object, ...]:
    """Return what sensors tell of a world and its hash does not cover."""
    return world.weather, world.light, world.datum, world.entities


def _as_loaded(world: World) -> World:
    return replace(world, solids=(), actors=(), materials={}, clutter=None)
