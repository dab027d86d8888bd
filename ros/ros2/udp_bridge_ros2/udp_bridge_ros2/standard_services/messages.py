# SPDX-License-Identifier: Apache-2.0
"""Messages of the standard from and to plain values."""

from __future__ import annotations

from math import isfinite
from typing import Any

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from simulation_interfaces.msg import (
    Bounds,
    EntityCategory,
    EntityInfo,
    EntityState,
    NamedPose,
    Resource,
    Spawnable,
    TagsFilter,
    WorldResource,
)

from .entity_filters import EntitySelection, TagSelection
from .overlap import ConvexRegion, Vector, box_region
from .posix_regex import compile_posix
from .request_refused import RequestRefused
from .world_queries import (
    Entity,
    PlainPose,
    PlainTwist,
    SpawnableObject,
    WorldDescription,
    WorldPose,
)

WORLD_FRAME = "world"
CATEGORIES = {
    EntityCategory.CATEGORY_OBJECT: "object",
    EntityCategory.CATEGORY_ROBOT: "robot",
    EntityCategory.CATEGORY_HUMAN: "human",
    EntityCategory.CATEGORY_DYNAMIC_OBJECT: "dynamic_object",
    EntityCategory.CATEGORY_STATIC_OBJECT: "static_object",
}
_NUMBERS = {name: number for number, name in CATEGORIES.items()}


def read_frame(header: Any) -> str:
    """Return the entity that a header names, or an empty text for the world."""
    return "" if header.frame_id == WORLD_FRAME else str(header.frame_id)


def read_pose(pose: Any) -> PlainPose:
    """Return position and orientation; refuse infinite numbers."""
    turn = pose.orientation
    position, orientation = _xyz(pose.position), (turn.x, turn.y, turn.z, turn.w)
    if not all(map(isfinite, (*position, *orientation))):
        raise RequestRefused("INVALID_POSE", "a pose must be of finite numbers")
    return position, orientation


def read_twist(twist: Any) -> PlainTwist:
    """Return linear and angular velocity, or acceleration; refuse infinite numbers."""
    linear, angular = _xyz(twist.linear), _xyz(twist.angular)
    if not all(map(isfinite, (*linear, *angular))):
        raise RequestRefused("RESULT_OPERATION_FAILED", "a velocity must be of finite numbers")
    return linear, angular


def read_category(category: Any) -> str:
    """Return the name of a category."""
    if name := CATEGORIES.get(category.category):
        return name
    numbers = ", ".join(map(str, sorted(CATEGORIES)))
    raise RequestRefused(
        "RESULT_OPERATION_FAILED", f"category {category.category}: expected one of {numbers}"
    )


def read_tags(filter_: Any) -> TagSelection:
    """Return the selection of a TagsFilter."""
    modes = {TagsFilter.FILTER_MODE_ANY: False, TagsFilter.FILTER_MODE_ALL: True}
    if filter_.filter_mode not in modes:
        raise RequestRefused(
            "RESULT_OPERATION_FAILED",
            f"filter mode {filter_.filter_mode}: expected 0 (any tag) or 1 (all tags)",
        )
    return TagSelection(frozenset(filter_.tags), modes[filter_.filter_mode])


def read_filters(filters: Any) -> EntitySelection:
    """Return the selection of EntityFilters."""
    try:
        name = compile_posix(filters.filter) if filters.filter else None
    except ValueError as error:
        raise RequestRefused("RESULT_OPERATION_FAILED", str(error)) from None
    return EntitySelection(
        name,
        frozenset(map(read_category, filters.categories)),
        read_tags(filters.tags),
        read_bounds(filters.bounds),
    )


def read_bounds(bounds: Any) -> ConvexRegion | None:
    """Return the region of Bounds, or None if they are empty."""
    points = tuple(map(_xyz, bounds.points))
    if not all(isfinite(number) for point in points for number in point):
        raise RequestRefused("RESULT_OPERATION_FAILED", "bounds must be of finite numbers")
    if bounds.type == Bounds.TYPE_EMPTY:
        return None
    if bounds.type == Bounds.TYPE_BOX and len(points) == 2:
        return box_region(*points)
    if bounds.type == Bounds.TYPE_SPHERE and len(points) == 2 and points[1][0] >= 0:
        return ConvexRegion(points[:1], points[1][0])
    if bounds.type == Bounds.TYPE_CONVEX_HULL and len(points) >= 3:
        return ConvexRegion(points)
    if bounds.type not in (Bounds.TYPE_BOX, Bounds.TYPE_SPHERE, Bounds.TYPE_CONVEX_HULL):
        raise RequestRefused(
            "RESULT_FEATURE_UNSUPPORTED",
            f"bounds of type {bounds.type}: expected 0 (none), 1 (box), 2 (hull) or 3 (sphere)",
        )
    raise RequestRefused(
        "RESULT_OPERATION_FAILED",
        "bounds: expected two corners of a box, a sphere's center and its radius as x of a second "
        f"point, or at least 3 points of a hull; got type {bounds.type} with {len(points)} points",
    )


def read_resource(owner: Any, field: str) -> tuple[str, str]:
    """Return uri and text of a field of type Resource.

    Version 1 of the standard has no such field, but `uri` and `resource_string` beside the others.
    """
    resource = getattr(owner, field, owner)
    return resource.uri, resource.resource_string


def entity_state(entity: Entity, stamp_nanos: int) -> Any:
    """Return an EntityState, in the frame of the world."""
    state = EntityState(pose=_pose(entity))
    state.header.stamp.sec, state.header.stamp.nanosec = divmod(stamp_nanos, 10**9)
    state.header.frame_id = WORLD_FRAME
    state.twist.linear = vector3(entity.linear_mps)
    state.twist.angular = vector3(entity.angular_radps)
    state.acceleration.linear = vector3(entity.linear_mps2)
    state.acceleration.angular = vector3(entity.angular_radps2)
    return state


def entity_info(entity: Entity) -> Any:
    """Return an EntityInfo; an unknown category is a generic object."""
    number = _NUMBERS.get(entity.category, EntityCategory.CATEGORY_OBJECT)
    return EntityInfo(
        category=EntityCategory(category=number),
        description=entity.description,
        tags=list(entity.tags),
    )


def box_bounds(low: Vector | None, high: Vector | None) -> Any:
    """Return Bounds of a box, or empty ones."""
    if low is None or high is None:
        return Bounds(type=Bounds.TYPE_EMPTY)
    return Bounds(type=Bounds.TYPE_BOX, points=[vector3(high), vector3(low)])


def spawnable(row: SpawnableObject) -> Any:
    """Return a Spawnable."""
    message = Spawnable(description=row.description, spawn_bounds=box_bounds(row.low_m, row.high_m))
    getattr(message, "entity_resource", message).uri = row.uri  # version 1 has `uri` itself
    return message


def named_pose(row: WorldPose) -> Any:
    """Return a NamedPose."""
    return NamedPose(
        name=row.name, description=row.description, tags=list(row.tags), pose=_pose(row)
    )


def world_resource(row: WorldDescription) -> Any:
    """Return a WorldResource."""
    return WorldResource(
        name=row.name,
        world_resource=Resource(uri=row.uri, resource_string=row.text),
        description=row.description,
        tags=list(row.tags),
    )


def vector3(vector: Vector) -> Any:
    """Return a Vector3."""
    x, y, z = vector
    return Vector3(x=x, y=y, z=z)


def _pose(row: Entity | WorldPose) -> Any:
    (x, y, z), turn = row.position_m, row.orientation
    orientation = Quaternion(x=turn[0], y=turn[1], z=turn[2], w=turn[3])
    return Pose(position=Point(x=x, y=y, z=z), orientation=orientation)


def _xyz(vector: Any) -> Vector:
    return (vector.x, vector.y, vector.z)
