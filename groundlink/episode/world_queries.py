# SPDX-License-Identifier: Apache-2.0
"""World queries: what tools that test robots ask of a run's world, and change in it.

A query is JSON in the payload of a query of `world_query_key`; the answer is JSON as well. Physics
answers between two ticks. An answer has `tick` and `stamp_nanos`, or `error` and `code`. Changes
are in the journal. Vectors are in meters, meters per second and radians per second; orientations
are quaternions xyzw; poses are in the world frame, or in that of the entity that `frame` names.
"""

from typing import Literal

import msgspec

from groundlink.core.errors import UserError
from groundlink.core.fields import Quaternion, Vector3
from groundlink.world.actors import Category

RefusalCode = Literal[
    "not_found",
    "name_taken",
    "name_invalid",
    "unsupported_format",
    "no_resource",
    "namespace_invalid",
    "parse_error",
    "missing_assets",
    "invalid_pose",
    "incorrect_state",
    "failed",
    "unsupported",
    "no_world",
]


class QueryRefused(UserError):
    """A world query that cannot be answered.

    Attributes
    ----------
    code
        kind of the problem, for programs.
    """

    def __init__(self, code: RefusalCode, problem: str) -> None:
        super().__init__(problem)
        self.code = code


class _WorldQuery(msgspec.Struct, frozen=True, tag_field="query", forbid_unknown_fields=True):
    """Base of the world queries."""


class EntitiesQuery(_WorldQuery, frozen=True, tag="entities"):
    """List the entities of the world with their states."""

    name: str = ""
    """Only this entity; empty for all."""


class SpawnQuery(_WorldQuery, frozen=True, tag="spawn"):
    """Add an entity to the world."""

    uri: str = ""
    """Name of a shipped vehicle or object, or a file on the host of physics: a path or `file://`.
    """

    text: str = ""
    """Content of a file, used if `uri` is empty."""

    name: str = ""
    """Name in the run; empty: that of the resource."""

    allow_renaming: bool = False
    """Whether a name that is taken or invalid is replaced by a similar one."""

    namespace: str = ""
    """Namespace of a vehicle's topics; empty: its name."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the entity's origin. An entity that would be in the ground is put on it."""

    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    frame: str = ""


class RemoveQuery(_WorldQuery, frozen=True, tag="remove"):
    """Remove an entity from the world."""

    name: str


class PlaceQuery(_WorldQuery, frozen=True, tag="place"):
    """Set pose and velocity of an entity. What is None stays as it is."""

    name: str
    position_m: Vector3 | None = None
    orientation: Quaternion | None = None
    linear_mps: Vector3 | None = None
    """Velocity of its origin, along the axes of the world."""

    angular_radps: Vector3 | None = None
    """Along the axes of the world."""

    frame: str = ""


class DescribeQuery(_WorldQuery, frozen=True, tag="describe"):
    """Replace category, description and tags of an entity, until a reset of what was spawned."""

    name: str
    category: Category = "object"
    description: str = ""
    tags: tuple[str, ...] = ()


Scope = Literal["time", "state", "spawned"]


class ResetQuery(_WorldQuery, frozen=True, tag="reset"):
    """Reset time, the state of all entities, or the set of entities."""

    scopes: tuple[Scope, ...]


class SpawnablesQuery(_WorldQuery, frozen=True, tag="spawnables"):
    """List what can be spawned by name."""

    sources: tuple[str, ...] = ()
    """Further folders on the host of physics to list files of."""


class NamedPosesQuery(_WorldQuery, frozen=True, tag="named_poses"):
    """List the named poses of the world and the start poses of the scenario's vehicles."""


class WorldInfoQuery(_WorldQuery, frozen=True, tag="world"):
    """Return name and description of the present world."""


class WorldsQuery(_WorldQuery, frozen=True, tag="worlds"):
    """List the worlds that are shipped."""

    sources: tuple[str, ...] = ()
    """Further folders on the host of physics to list files of."""


class LoadWorldQuery(_WorldQuery, frozen=True, tag="load_world"):
    """Replace the world of the run, and begin a new episode in it, paused at tick 0.

    All that was spawned is gone. The run's vehicles start where those of a loaded scenario start,
    in their order, and at their own starts in a world without vehicles.
    """

    uri: str = ""
    """Name of a shipped scenario or world, or a file on the host of physics: a path or `file://`.
    """

    text: str = ""
    """Content of a file, used if `uri` is empty."""


class UnloadWorldQuery(_WorldQuery, frozen=True, tag="unload_world"):
    """Remove the world of the run. Time stands still until another one is loaded."""


AnyWorldQuery = (
    EntitiesQuery
    | SpawnQuery
    | RemoveQuery
    | PlaceQuery
    | DescribeQuery
    | ResetQuery
    | SpawnablesQuery
    | NamedPosesQuery
    | WorldInfoQuery
    | WorldsQuery
    | LoadWorldQuery
    | UnloadWorldQuery
)


class EntityReport(msgspec.Struct, frozen=True, kw_only=True):
    """An entity in the answer to `EntitiesQuery`."""

    name: str
    category: Category
    description: str
    tags: tuple[str, ...]
    is_static: bool
    position_m: Vector3
    """World from the entity's frame."""

    orientation: Quaternion
    linear_mps: Vector3
    """Velocity of its origin, along the axes of the world."""

    angular_radps: Vector3
    linear_mps2: Vector3
    """Mean of the last tick; zero for what moves on a script or is pushed."""

    angular_radps2: Vector3
    low_m: Vector3
    """Lowest corner of the box around it, in its own frame."""

    high_m: Vector3


class SpawnableReport(msgspec.Struct, frozen=True):
    """What can be spawned: its name or file, and the box around it in its own frame."""

    uri: str
    description: str
    low_m: Vector3
    high_m: Vector3


class NamedPoseReport(msgspec.Struct, frozen=True):
    """A named pose in the world; the box is in its own frame."""

    name: str
    description: str
    tags: tuple[str, ...]
    position_m: Vector3
    orientation: Quaternion
    low_m: Vector3 | None
    high_m: Vector3 | None


class WorldReport(msgspec.Struct, frozen=True, omit_defaults=True):
    """A world: of the run, or one that is shipped."""

    name: str
    uri: str
    description: str
    tags: tuple[str, ...]
    text: str = ""
    """Content of the file, of a world that was loaded from it."""
