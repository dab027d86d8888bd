# SPDX-License-Identifier: Apache-2.0
"""Entities of a world: vehicles, actors, and groups of static solids that tools know by one name.

The room is one entity, each piece of furniture and each outdoor object is one, and so are the
solids that were spawned together. Every other solid is an entity of its own.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import cos, radians, sin

import msgspec
import numpy as np
from msgspec.structs import replace

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import (
    IDENTITY_QUATERNION,
    conjugate,
    matrix_from_quaternion,
    multiply,
)
from groundlink.scenario.additions import SolidGroup
from groundlink.scenario.schema import Scenario
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.actors import Actor, Category, FreeMotion, PersonForm
from groundlink.world.bounds import bounds
from groundlink.world.objects.indoor_objects import build_furniture, build_room
from groundlink.world.objects.outdoor_objects import build_outdoor_object
from groundlink.world.solids import Solid

from .bodies import link_solids
from .build import solids
from .spawn_pose import collision_solids

Corners = tuple[Vector3, Vector3]
"""Lowest and highest corner of a box."""

Pose = tuple[Vector3, Quaternion]

ORIGIN: Pose = ((0.0, 0.0, 0.0), IDENTITY_QUATERNION)


class StaticEntity(msgspec.Struct, frozen=True):
    """An entity of static solids."""

    name: str
    parts: tuple[str, ...]
    """Names of its solids."""

    pose: Pose
    """World from its frame."""

    box_m: Corners
    """Box around it in its frame."""


def static_entities(
    scenario: Scenario, groups: Mapping[str, SolidGroup]
) -> dict[str, StaticEntity]:
    """Return the static entities of a world by name; `groups` have been spawned."""
    built = {solid.name: solid for solid in solids(scenario)}
    found: dict[str, StaticEntity] = {}
    for group in groups.values():
        if all(part in built for part in group.parts):
            members = [built.pop(part) for part in group.parts]
            pose = group.position_m, group.orientation
            found[group.name] = _entity(group.name, members, pose)
    for name, parts, pose in _fixed(scenario):
        for part in parts:
            built.pop(part.name, None)
        found[name] = _entity(name, parts, pose)
    for name, solid in built.items():
        found[name] = _entity(name, [solid], (solid.position_m, solid.orientation))
    return found


def _fixed(scenario: Scenario) -> Iterator[tuple[str, Sequence[Solid], Pose]]:
    """Yield name, solids and pose of what belongs to the world for good."""
    world = scenario.world
    if world.room:
        yield "room", build_room(world.room), ORIGIN
    for index, furniture in enumerate(world.furniture):
        x, y = furniture.at_m[:2]
        name = f"{furniture.__struct_config__.tag}_{index}"
        pose = upright(x, y, 0.0, getattr(furniture, "yaw_deg", 0.0))
        yield name, build_furniture(index, furniture)[0], pose
    for index, thing in enumerate(world.outdoors):
        x, y = getattr(thing, "at_m", (0.0, 0.0))
        z = getattr(thing, "z_m", None) or 0.0
        name = f"{thing.__struct_config__.tag}_{index}"
        pose = upright(x, y, z, getattr(thing, "yaw_deg", 0.0))
        yield name, build_outdoor_object(index, thing), pose


def _entity(name: str, parts: Sequence[Solid], pose: Pose) -> StaticEntity:
    box = box_around(in_frame(part, pose) for part in parts)
    return StaticEntity(name, tuple(part.name for part in parts), pose, box)


def upright(x_m: float, y_m: float, z_m: float, yaw_deg: float) -> Pose:
    """Return the pose of what stands upright."""
    half = radians(yaw_deg) / 2
    return (x_m, y_m, z_m), (0.0, 0.0, sin(half), cos(half))


def in_frame(solid: Solid, pose: Pose) -> Solid:
    """Return a solid of the world in the frame of a pose."""
    position, orientation = relative((solid.position_m, solid.orientation), pose)
    return replace(solid, position_m=position, orientation=orientation)


def relative(pose: Pose, frame: Pose) -> Pose:
    """Return a pose of the world in a frame, both in the world."""
    offset = np.subtract(pose[0], frame[0])
    x, y, z = (matrix_from_quaternion(frame[1]).T @ offset).tolist()
    turn: Quaternion = tuple(multiply(conjugate(frame[1]), pose[1]).tolist())
    return (x, y, z), turn


def composed(outer: Pose, inner: Pose) -> Pose:
    """Return the pose a_from_c of a_from_b and b_from_c."""
    position = matrix_from_quaternion(outer[1]) @ np.array(inner[0]) + outer[0]
    x, y, z = position.tolist()
    turn: Quaternion = tuple(multiply(outer[1], inner[1]).tolist())
    return (x, y, z), turn


def box_around(parts: Iterable[Solid]) -> Corners:
    """Return the corners of the box around solids along the axes of their frame."""
    corners = [bounds(part) for part in parts]
    low = np.min([low for low, _ in corners], axis=0)
    high = np.max([high for _, high in corners], axis=0)
    return tuple(low.tolist()), tuple(high.tolist())


def vehicle_solids(model: VehicleModel) -> list[Solid]:
    """Return the solids of base and wheels in the base frame, with wheels straight ahead."""
    base, *others = link_solids(model)
    parts = [*base, *collision_solids(model)]
    for wheel, visuals in zip(model.wheels, others, strict=False):
        hub: Pose = (wheel.center_m, IDENTITY_QUATERNION)
        parts += [in_world(visual, hub) for visual in visuals]
    return parts


def in_world(solid: Solid, pose: Pose) -> Solid:
    """Return a solid of the frame of a pose in the world."""
    position, orientation = composed(pose, (solid.position_m, solid.orientation))
    return replace(solid, position_m=position, orientation=orientation)


def moved_pose(solid: Solid, before: Pose, after: Pose) -> Pose:
    """Return the pose of a solid after the entity that it belongs to has moved."""
    return composed(after, relative((solid.position_m, solid.orientation), before))


def actor_category(actor: Actor) -> Category:
    """Return the category of an actor that nobody has described."""
    return "human" if isinstance(actor.form, PersonForm) else "dynamic_object"


def is_free(actor: Actor) -> bool:
    """Return whether physics moves an actor."""
    return isinstance(actor.motion, FreeMotion)
