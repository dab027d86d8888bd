# SPDX-License-Identifier: Apache-2.0
"""Changes of a running scenario: add or remove objects.

The functions are pure. A changed world is another scenario with another hash. Clutter is first
converted to plain solids, so that it keeps its positions. An added object needs a unique name and a
free position.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from groundlink.core.errors import UserError, did_you_mean
from groundlink.core.fields import Quaternion, Vector3
from groundlink.scenario.additions import Addition
from groundlink.scenario.schema import RESERVED_NAMES, Scenario
from groundlink.scene.build import solids
from groundlink.scene.spawn_checks import (
    actor_bodies,
    check_actor_path,
    check_vehicle,
    first_overlap,
    ground_of,
)
from groundlink.world import actor_motion as motion
from groundlink.world.actors import FreeMotion
from groundlink.world.bounds import bounds
from groundlink.world.solids import Solid
from groundlink.world.terrain import Ground

RESTS_M = 0.01
"""Largest overlap, in meters, of an added object with the surface that it stands on."""


def with_more(
    scenario: Scenario, more: Addition, moving: Sequence[Solid], *, seconds: float
) -> Scenario:
    """Return a scenario with an addition at a sim time.

    Parameters
    ----------
    moving
        collision solids of vehicles and actors at their current poses.

    Raises
    ------
    UserError
        when a name is taken, a material is unknown, or a position is occupied.
    """
    standing = solids(scenario)
    taken = [*_names(scenario), *(solid.name for solid in standing)]
    for name in more.names():
        if name in taken:
            raise UserError(f"the name `{name}` is taken. Fix: choose another name with --name")
        taken.append(name)
    for vehicle in more.vehicles:
        if vehicle.name in RESERVED_NAMES:
            raise UserError(
                f"`{vehicle.name}` is reserved for a key of the bus. Fix: choose another name with "
                "--name"
            )
    frozen = _frozen(scenario)
    world = frozen.world
    changed = replace(
        frozen,
        vehicles=(*frozen.vehicles, *more.vehicles),
        world=replace(
            world,
            materials=more.materials | world.materials,
            solids=(*world.solids, *more.solids),
            actors=(*world.actors, *more.actors),
        ),
    )
    solids(changed)
    _check_room(changed, more, standing, moving, seconds)
    return changed


def without(scenario: Scenario, name: str) -> Scenario:
    """Return a scenario without a vehicle, an actor or a solid of exactly this name.

    If there is none, all solids whose names begin with the name and an underscore are removed: the
    parts of an object.

    Raises
    ------
    UserError
        when there is no such object, or it cannot be removed.
    """
    frozen = _frozen(scenario)
    world = frozen.world
    vehicles = tuple(vehicle for vehicle in frozen.vehicles if vehicle.name != name)
    if not vehicles:
        raise UserError(f"`{name}` is the run's only vehicle. Fix: spawn another one first")
    actors = tuple(actor for actor in world.actors if actor.name != name)
    left = tuple(solid for solid in world.solids if solid.name != name)
    if name not in _all_names(frozen):
        left = tuple(solid for solid in left if not solid.name.startswith(f"{name}_"))
    changed = replace(frozen, vehicles=vehicles, world=replace(world, actors=actors, solids=left))
    if changed == frozen:
        if any(f"{solid.name}_".startswith(f"{name}_") for solid in solids(scenario)):
            raise UserError(
                f"`{name}` is part of the world and cannot be removed; expected a vehicle, "
                "solid or actor"
            )
        raise UserError(f"no vehicle or object `{name}`; {did_you_mean(name, _all_names(frozen))}")
    return changed


def without_parts(scenario: Scenario, name: str, parts: Collection[str]) -> Scenario:
    """Return a scenario without the vehicles, actors and solids of exactly these names.

    Raises
    ------
    UserError
        when one of them cannot be removed; `name` names them all.
    """
    frozen = _frozen(scenario)
    world = frozen.world
    vehicles = tuple(vehicle for vehicle in frozen.vehicles if vehicle.name not in parts)
    if not vehicles:
        raise UserError(f"`{name}` is the run's only vehicle. Fix: spawn another one first")
    actors = tuple(actor for actor in world.actors if actor.name not in parts)
    left = tuple(solid for solid in world.solids if solid.name not in parts)
    changed = replace(frozen, vehicles=vehicles, world=replace(world, actors=actors, solids=left))
    if len(_all_names(frozen)) - len(_all_names(changed)) != len(parts):
        raise UserError(
            f"`{name}` is part of the world and cannot be removed. Fix: remove it from the "
            "scenario's file"
        )
    return changed


def with_moved(
    scenario: Scenario,
    name: str,
    poses: Mapping[str, tuple[Vector3, Quaternion]],
    moving: Sequence[Solid],
) -> Scenario:
    """Return a scenario whose static solids have other poses, by their names.

    Parameters
    ----------
    moving
        collision solids of vehicles and actors at their current poses.

    Raises
    ------
    UserError
        when a solid cannot be moved, or would be inside a vehicle or an actor.
    """
    frozen = _frozen(scenario)
    known = {solid.name: solid for solid in frozen.world.solids}
    if not poses.keys() <= known.keys():
        raise UserError(
            f"`{name}` is part of the world and cannot be moved. Fix: move it in the scenario's "
            "file, or spawn an object in its place"
        )
    for part, (position, orientation) in poses.items():
        known[part] = replace(known[part], position_m=position, orientation=orientation)
    _check_free(name, [known[part] for part in poses], moving)
    return replace(frozen, world=replace(frozen.world, solids=tuple(known.values())))


def _all_names(scenario: Scenario) -> list[str]:
    return [*_names(scenario), *(solid.name for solid in scenario.world.solids)]


def _names(scenario: Scenario) -> list[str]:
    vehicles = (vehicle.name for vehicle in scenario.vehicles)
    return [*vehicles, *(actor.name for actor in scenario.world.actors)]


def _frozen(scenario: Scenario) -> Scenario:
    """Return a scenario with its clutter converted to solids, in the same order."""
    world = replace(scenario.world, clutter=None)
    clutter = solids(scenario)[len(solids(replace(scenario, world=world))) :]
    return replace(scenario, world=replace(world, solids=(*world.solids, *clutter)))


def _check_room(
    changed: Scenario,
    more: Addition,
    standing: Sequence[Solid],
    moving: Sequence[Solid],
    seconds: float,
) -> None:
    """Refuse added objects that overlap others. Static solids may overlap static solids."""
    ground = ground_of(changed)
    there = [*standing, *moving]
    for solid in more.solids:
        _check_free(solid.name, [solid], moving)
        _check_floor(solid.name, [solid], standing, ground)
        there.append(solid)
    for actor in more.actors:
        check_actor_path(changed.world.actors.index(actor), actor, ground)
        place = motion.initial_pose(actor.motion, ground, seconds)
        bodies = actor_bodies(actor, place.position_m, place.orientation)
        _check_free(actor.name, bodies, there if isinstance(actor.motion, FreeMotion) else moving)
        _check_floor(actor.name, bodies, standing, ground)
        there += bodies
    for vehicle in more.vehicles:
        there += check_vehicle(changed.vehicles.index(vehicle), vehicle, ground, there)


def _check_floor(
    name: str, bodies: Sequence[Solid], standing: Sequence[Solid], ground: Ground | None
) -> None:
    """Refuse objects beside all solids in a world without terrain."""
    if ground is not None:
        return
    boxes = [bounds(solid) for solid in standing]
    for low, high in map(bounds, bodies):
        if any(np.all(low[:2] <= b[:2]) and np.all(a[:2] <= high[:2]) for a, b in boxes):
            return
    x_m, y_m, _ = bodies[0].position_m
    raise UserError(
        f"`{name}` would be at {x_m:g}, {y_m:g}, outside this world. Fix: choose another place"
    )


def _check_free(name: str, bodies: Sequence[Solid], there: Sequence[Solid]) -> None:
    lifted = []
    for body in bodies:
        x, y, z = body.position_m
        lifted.append(replace(body, position_m=(x, y, z + RESTS_M)))
    if (other := first_overlap(lifted, there)) is not None:
        raise UserError(f"`{name}` would be inside `{other}`. Fix: choose another place")
