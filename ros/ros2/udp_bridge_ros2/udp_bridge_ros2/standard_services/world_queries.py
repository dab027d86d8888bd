# SPDX-License-Identifier: Apache-2.0
"""Queries about the simulated world, which physics answers: JSON texts in both directions.

`groundlink/episode/world_queries.py` has their schema. Vectors are in SI units, and in the frame of
the world unless a query names another frame.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

from udp_bridge.node.command_client import CommandFailed

from .overlap import Quaternion, Vector
from .request_refused import RequestRefused

CONSTANTS = {
    "not_found": "RESULT_NOT_FOUND",
    "incorrect_state": "RESULT_INCORRECT_STATE",
    "failed": "RESULT_OPERATION_FAILED",
    "unsupported": "RESULT_FEATURE_UNSUPPORTED",
    "name_taken": "NAME_NOT_UNIQUE",
    "name_invalid": "NAME_INVALID",
    "unsupported_format": "UNSUPPORTED_FORMAT",
    "no_resource": "NO_RESOURCE",
    "namespace_invalid": "NAMESPACE_INVALID",
    "parse_error": "RESOURCE_PARSE_ERROR",
    "missing_assets": "MISSING_ASSETS",
    "invalid_pose": "INVALID_POSE",
    "no_world": "NO_WORLD_LOADED",
}
"""Result codes by the codes of physics."""


class Entity(NamedTuple):
    """Vehicle, person, object or solid of the world."""

    name: str
    category: str
    description: str
    tags: tuple[str, ...]
    is_static: bool
    position_m: Vector
    orientation: Quaternion
    linear_mps: Vector
    angular_radps: Vector
    linear_mps2: Vector
    angular_radps2: Vector
    low_m: Vector | None
    """Lower corner of its box, in its own frame; None if it has no size."""
    high_m: Vector | None


class SpawnableObject(NamedTuple):
    """What `spawn` accepts as `uri`."""

    uri: str
    description: str
    low_m: Vector | None
    high_m: Vector | None


class WorldPose(NamedTuple):
    """Named pose of the world."""

    name: str
    description: str
    tags: tuple[str, ...]
    position_m: Vector
    orientation: Quaternion
    low_m: Vector | None
    high_m: Vector | None


class WorldDescription(NamedTuple):
    """A world that is loaded or can be loaded."""

    name: str
    uri: str
    description: str
    tags: tuple[str, ...]
    text: str = ""
    """Content of the file, of a world that was loaded from it."""


PlainPose = tuple[Vector, Quaternion]
"""Position in meters, and orientation."""
PlainTwist = tuple[Vector, Vector]
"""Linear velocity in m/s and angular velocity in rad/s."""

Row = TypeVar("Row")


class WorldQueries:
    """Asks physics; each call returns its answer.

    Raises
    ------
    RequestRefused
        When physics refuses.
    CommandFailed
        When there is no answer, or it can't be read.
    """

    def __init__(self, ask: Callable[[str], str]) -> None:
        self._ask = ask

    def entities(self) -> tuple[int, list[Entity]]:
        """Return all entities, and the stamp of their states in nanoseconds."""
        answer = self._answer("entities")
        return _stamp_nanos(answer), _rows(Entity, answer, "entities")

    def entity(self, name: str) -> tuple[int, Entity]:
        """Return one entity, and the stamp of its state in nanoseconds."""
        if not name:
            raise RequestRefused("RESULT_NOT_FOUND", "the name of an entity is missing")
        answer = self._answer("entities", name=name)
        rows = _rows(Entity, answer, "entities")
        if [row.name for row in rows] != [name]:
            raise CommandFailed(f"physics answered with another entity than {name!r}")
        return _stamp_nanos(answer), rows[0]

    def spawn(
        self,
        name: str,
        pose: PlainPose,
        frame: str,
        *,
        uri: str,
        text: str,
        allow_renaming: bool,
        namespace: str,
    ) -> str:
        """Put an object into the world; return its name."""
        answer = self._answer(
            "spawn",
            name=name,
            position_m=pose[0],
            orientation=pose[1],
            frame=frame,
            uri=uri,
            text=text,
            allow_renaming=allow_renaming,
            namespace=namespace,
        )
        return str(answer.get("name", name))

    def remove(self, name: str) -> None:
        """Remove an entity."""
        self._answer("remove", name=name)

    def place(
        self, name: str, pose: PlainPose | None, twist: PlainTwist | None, frame: str
    ) -> None:
        """Set an entity's pose and velocity, unless None."""
        position_m, orientation = pose or (None, None)
        linear_mps, angular_radps = twist or (None, None)
        self._answer(
            "place",
            name=name,
            position_m=position_m,
            orientation=orientation,
            linear_mps=linear_mps,
            angular_radps=angular_radps,
            frame=frame,
        )

    def describe(self, name: str, category: str, description: str, tags: Sequence[str]) -> None:
        """Replace an entity's category, description and tags."""
        self._answer(
            "describe", name=name, category=category, description=description, tags=list(tags)
        )

    def reset(self, scopes: Sequence[str]) -> None:
        """Reset `time`, `state` or `spawned` objects."""
        self._answer("reset", scopes=list(scopes))

    def spawnables(self, sources: Sequence[str]) -> tuple[list[SpawnableObject], list[str]]:
        """Return what can be spawned, and the sources that physics doesn't know."""
        answer = self._answer("spawnables", sources=list(sources))
        return _rows(SpawnableObject, answer, "spawnables"), _texts(answer, "unknown")

    def named_poses(self) -> list[WorldPose]:
        """Return the named poses of the world."""
        return _rows(WorldPose, self._answer("named_poses"), "poses")

    def world(self) -> WorldDescription:
        """Return the loaded world."""
        return _row(WorldDescription, self._answer("world"), "world")

    def worlds(self, sources: Sequence[str]) -> tuple[list[WorldDescription], list[str]]:
        """Return the worlds that can be loaded, and the sources that physics doesn't know."""
        answer = self._answer("worlds", sources=list(sources))
        return _rows(WorldDescription, answer, "worlds"), _texts(answer, "unknown")

    def has_world(self) -> bool:
        """Return whether a world is loaded."""
        try:
            self.world()
        except RequestRefused as refused:
            if refused.constant != CONSTANTS["no_world"]:
                raise
            return False
        return True

    def load_world(self, uri: str, text: str) -> WorldDescription:
        """Load another world, paused at its start; return it."""
        return _row(WorldDescription, self._answer("load_world", uri=uri, text=text), "world")

    def unload_world(self) -> None:
        """Unload the world."""
        self._answer("unload_world")

    def _answer(self, query: str, **fields: Any) -> dict[str, Any]:
        text = self._ask(json.dumps({"query": query, **fields}, allow_nan=False))
        try:
            answer = json.loads(text)
        except ValueError as error:
            raise CommandFailed(f"physics' answer is no JSON: {error}") from None
        if not isinstance(answer, dict):
            raise CommandFailed("physics' answer is no JSON object")
        if problem := answer.get("error"):
            code = str(answer.get("code"))
            raise RequestRefused(CONSTANTS.get(code, "RESULT_OPERATION_FAILED"), str(problem))
        return answer


def _rows(kind: type[Row], answer: dict[str, Any], key: str) -> list[Row]:
    try:
        return [_read(kind, fields) for fields in answer[key]]
    except (KeyError, TypeError, ValueError) as error:
        raise CommandFailed(f"{key} in physics' answer can't be read: {error!r}") from None


def _row(kind: type[Row], answer: dict[str, Any], key: str) -> Row:
    return _rows(kind, {key: [answer.get(key)]}, key)[0]


def _read(kind: Any, fields: dict[str, Any]) -> Any:
    return kind(**{name: _READERS[name](fields[name]) for name in kind._fields if name in fields})


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"expected a text, got {value!r}")
    return value


def _texts(answer: dict[str, Any], key: str) -> list[str]:
    return [str(text) for text in answer.get(key) or ()]


def _vector(value: Any) -> Vector:
    x, y, z = map(float, value)
    return x, y, z


def _vector_or_none(value: Any) -> Vector | None:
    return None if value is None else _vector(value)


def _quaternion(value: Any) -> Quaternion:
    x, y, z, w = map(float, value)
    return x, y, z, w


_READERS: dict[str, Callable[[Any], Any]] = {
    "name": _text,
    "text": _text,
    "uri": _text,
    "category": _text,
    "description": _text,
    "tags": lambda value: tuple(map(_text, value)),
    "is_static": bool,
    "position_m": _vector,
    "orientation": _quaternion,
    "linear_mps": _vector,
    "angular_radps": _vector,
    "linear_mps2": _vector,
    "angular_radps2": _vector,
    "low_m": _vector_or_none,
    "high_m": _vector_or_none,
}
"""How a field is read."""


def _stamp_nanos(answer: dict[str, Any]) -> int:
    stamp = answer.get("stamp_nanos")
    if not isinstance(stamp, int):
        raise CommandFailed("physics' answer has no stamp")
    return stamp
