# SPDX-License-Identifier: Apache-2.0
"""Checks that vehicles, actors and additions have room where they spawn.

Collision solids are compared as oriented boxes. Meshes are left out, since the box around a scan of
a yard would block the whole yard.
"""

from collections.abc import Iterable

import numpy as np
from msgspec.structs import replace

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import multiply, transform
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world import actor_motion as motion
from groundlink.world import terrain
from groundlink.world.actors import Actor, form_solids
from groundlink.world.bounds import bounds, intersect
from groundlink.world.solids import Mesh, Solid
from groundlink.world.terrain import Ground

from .build import WorldError
from .spawn_pose import collision_solids, spawn_pose

MAX_DROP_M = 5.0
"""Largest height of a spawn place above the ground, in meters. A larger height is a mistake."""


def check_spawns(scenario: Scenario, built: Iterable[Solid]) -> None:
    """Refuse a vehicle that overlaps another object at its spawn pose.

    Physics would eject such a vehicle. Only the loader calls this function, since it needs the
    terrain assets.

    Raises
    ------
    WorldError
        when a vehicle overlaps another object, or an actor or vehicle is off the terrain.
    """
    there = list(built)
    ground = ground_of(scenario)
    for index, actor in enumerate(scenario.world.actors):
        check_actor_path(index, actor, ground)
        place = motion.initial_pose(actor.motion, ground)
        there += actor_bodies(actor, place.position_m, place.orientation)
    for index, vehicle in enumerate(scenario.vehicles):
        there += check_vehicle(index, vehicle, ground, there)


def check_vehicle(
    index: int, vehicle: Vehicle, ground: Ground | None, there: Iterable[Solid]
) -> list[Solid]:
    """Return the collision solids of a vehicle at its spawn pose, in the world.

    Raises
    ------
    WorldError
        when it overlaps an object, or spawns outside, below or high above the ground.
    """
    path = "vehicles", index, "placement"
    place = vehicle.placement
    if ground is not None and not ground.inside(place.x_m, place.y_m):
        rows, columns = ground.heights.shape
        east, north = (
            f"{at_m:g} to {at_m + (count - 1) * ground.cell_m:g} m"
            for at_m, count in ((ground.x0_m, columns), (ground.y0_m, rows))
        )
        raise WorldError(
            path,
            f"`{vehicle.name}` starts outside the terrain; expected x_m from {east} and y_m from "
            f"{north}",
        )
    if ground is not None and place.z_m < 0:
        raise WorldError(
            (*path, "z_m"),
            f"`{vehicle.name}` starts in the terrain; expected the height above it, 0 or more",
        )
    there = list(there)
    bodies = vehicle_bodies(vehicle.name, vehicle.model, *spawn_pose(vehicle, ground))
    if (other := first_overlap(bodies, there)) is not None:
        raise WorldError(path, f"`{vehicle.name}` starts inside `{other}`. Fix: move it")
    if ground is None and (problem := floor_problem(place.x_m, place.y_m, place.z_m, there)):
        raise WorldError(path, f"`{vehicle.name}` {problem}")
    if place.z_m > MAX_DROP_M:
        raise WorldError(
            (*path, "z_m"),
            f"`{vehicle.name}` starts {place.z_m:g} m above the ground; expected at most "
            f"{MAX_DROP_M:g} m",
        )
    return bodies


def floor_problem(x_m: float, y_m: float, z_m: float, there: Iterable[Solid]) -> str:
    """Return the problem of a spawn place on solids; "" for none.

    Parameters
    ----------
    z_m
        height of the place above z = 0; solids above it do not support it.
    """
    boxes = [bounds(solid) for solid in there]
    if any(
        np.all(low[:2] <= (x_m, y_m)) and np.all((x_m, y_m) <= high[:2]) and low[2] <= z_m
        for low, high in boxes
    ):
        return ""
    if not boxes:
        return "starts in a world without a floor; expected terrain, a room or solids"
    low, high = (
        np.min([box[0] for box in boxes], axis=0),
        np.max([box[1] for box in boxes], axis=0),
    )
    return (
        f"starts at {x_m:g}, {y_m:g}, where nothing is below it; expected a place on the floor, "
        f"within x_m from {low[0]:.2f} to {high[0]:.2f} and y_m from {low[1]:.2f} to {high[1]:.2f}"
    )


def check_actor_path(index: int, actor: Actor, ground: Ground | None) -> None:
    """Refuse an actor whose path leaves the terrain.

    Raises
    ------
    WorldError
        when the path leaves the terrain.
    """
    if ground is not None and not all(ground.inside(*at) for at in motion.waypoints(actor.motion)):
        raise WorldError(
            ("world", "actors", index, "motion"),
            f"`{actor.name}` moves outside the terrain. Fix: move it",
        )


def actor_bodies(actor: Actor, position_m: Vector3, orientation: Quaternion) -> list[Solid]:
    """Return the collision solids of an actor at a pose, in the world, with the actor's name."""
    return _placed(form_solids(actor.form), actor.name, position_m, orientation)


def vehicle_bodies(
    name: str, model: VehicleModel, position_m: Vector3, orientation: Quaternion
) -> list[Solid]:
    """Return the collision solids of a vehicle at a pose, in the world, with the vehicle's name."""
    return _placed(collision_solids(model), name, position_m, orientation)


def first_overlap(bodies: Iterable[Solid], there: Iterable[Solid]) -> str | None:
    """Return the name of the first solid that overlaps one of the bodies, or None."""
    solid = [solid for solid in there if not isinstance(solid.shape, Mesh)]
    return next((s.name for body in bodies for s in solid if intersect(body, s)), None)


def ground_of(scenario: Scenario) -> Ground | None:
    """Return the terrain of a scenario's world, or None."""
    return terrain.load_ground(scenario.world.terrain) if scenario.world.terrain else None


def _placed(
    solids: Iterable[Solid], name: str, position_m: Vector3, orientation: Quaternion
) -> list[Solid]:
    world_from_body = transform(position_m, orientation)
    return [
        replace(
            part,
            name=name,
            position_m=tuple((world_from_body @ (*part.position_m, 1.0))[:3].tolist()),
            orientation=tuple(multiply(orientation, part.orientation).tolist()),
        )
        for part in solids
        if not isinstance(part.shape, Mesh)
    ]
