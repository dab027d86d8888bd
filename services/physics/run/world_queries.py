# SPDX-License-Identifier: Apache-2.0
"""Answers to world queries: what is in the world, and changes of it that tools ask for.

Queries arrive on the bus's threads. What takes long, such as reading files, happens there; the
loop that steps reads and changes the world between two ticks.
"""

import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from math import degrees, hypot, isfinite, sqrt
from typing import Protocol, TypeVar

import msgspec

from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import matrix_from_quaternion
from groundlink.core.quaternions import heading_rad
from groundlink.episode.control import Move, Remove, Spawn, WorldChange
from groundlink.episode.world_queries import (
    AnyWorldQuery,
    DescribeQuery,
    EntitiesQuery,
    LoadWorldQuery,
    NamedPosesQuery,
    PlaceQuery,
    QueryRefused,
    RefusalCode,
    RemoveQuery,
    ResetQuery,
    Scope,
    SpawnablesQuery,
    SpawnQuery,
    UnloadWorldQuery,
    WorldInfoQuery,
    WorldReport,
    WorldsQuery,
)
from groundlink.loader.additions import SpawnPlace, free_name, placed
from groundlink.scenario.additions import SolidGroup
from groundlink.scenario.schema import RESERVED_NAMES, Scenario
from groundlink.scene.build import solids
from groundlink.scene.entities import (
    Pose,
    StaticEntity,
    composed,
    is_free,
    moved_pose,
    relative,
    upright,
)
from groundlink.scene.loaded_world import distinct, has_world, without_world
from groundlink.world.actors import EntityDescription
from services.physics.dynamics.backend import Twist

from .control import ANSWER_SECONDS, LOADING_SECONDS
from .entities import STILL, WorldView
from .episode import Episode
from .spawn_resources import SpawnResource, in_namespace, resource, spawnables, worlds
from .world_loading import WorldSource, named_poses, scenario_in, world_report

NAME = re.compile(r"[a-z][a-z0-9_]*")

FARTHEST_M = 1e6
"""Largest coordinate of a pose."""

UNIT = 0.01
"""Largest error of the length of a quaternion."""

UPRIGHT = 1e-6
"""Largest sine of the tilt of what stands upright."""

Answer = dict[str, object]

T = TypeVar("T")


class QueriedRun(Protocol):
    """What world queries act on. Each method raises a UserError where it cannot."""

    episode: Episode
    as_loaded: Scenario
    """Scenario of the world that was loaded last: that of the start before the first."""

    world_source: WorldSource

    @property
    def first_scenario(self) -> Scenario:
        """Scenario with which the run was started."""

    def refuse_while_restoring(self) -> None:
        """Refuse a change while a saved run is restored."""

    def between_ticks(self, do: Callable[[], T], *, seconds: float = ANSWER_SECONDS) -> T:
        """Call a function between two ticks."""

    def known_worlds(self) -> dict[str, Scenario]:
        """Return the scenarios of all worlds so far, by their hashes."""

    def load(self, scenario: Scenario, source: WorldSource) -> None:
        """Start a new episode in another world, paused."""

    def change(self, command: WorldChange) -> None:
        """Change the world."""

    def reset(self) -> None:
        """Start a new episode of the present world."""

    def reset_all(self) -> None:
        """Start a new episode of the world as it was loaded."""

    def reset_state(self) -> None:
        """Put everything back where it began, without a new episode."""


class WorldQueryAnswers:
    """Answers the world queries of one run."""

    def __init__(self, run: QueriedRun) -> None:
        self._run = run
        self._view: WorldView | None = None

    def answer(self, _: str, content: bytes) -> list[bytes]:
        """Return the answer to the query in a payload, as JSON."""
        try:
            query = msgspec.json.decode(content, type=AnyWorldQuery)
            answer = self._answer(query)
        except QueryRefused as refusal:
            answer = {"error": str(refusal), "code": refusal.code}
        except msgspec.DecodeError as problem:
            # The node may know queries that physics does not.
            code = "unsupported" if str(problem).startswith("Invalid value") else "failed"
            answer = {"error": f"not a world query: {problem}", "code": code}
        except UserError as problem:
            answer = {"error": str(problem), "code": "failed"}
        return [msgspec.json.encode(answer)]

    def _answer(self, query: AnyWorldQuery) -> Answer:
        match query:
            case EntitiesQuery():
                return self._entities(query)
            case SpawnQuery():
                return self._spawn(query)
            case RemoveQuery() | PlaceQuery() | DescribeQuery() | ResetQuery():
                self._present_view()
                return self._run.between_ticks(lambda: self._change(query))
            case SpawnablesQuery(sources=sources):
                found, unknown = spawnables(sources)
                return self._now(spawnables=found, unknown=unknown)
            case NamedPosesQuery():
                return self._now(poses=named_poses(self._run.episode.scenario))
            case WorldInfoQuery():
                return self._now(world=self._world())
            case WorldsQuery(sources=sources):
                known, unknown = worlds(sources)
                return self._now(worlds=known, unknown=unknown)
            case LoadWorldQuery():
                return self._load(query)
            case UnloadWorldQuery():
                return self._run.between_ticks(self._unload, seconds=LOADING_SECONDS)

    def _now(self, **content: object) -> Answer:
        """Return an answer about the present tick."""
        return _at(self._run.episode, self._run.episode.tick, content)

    def _world(self) -> WorldReport:
        """Return the present world."""
        if not has_world(self._run.episode.scenario):
            raise _without_world("no_world")
        return world_report(self._run.episode.scenario, self._run.world_source)

    def _load(self, query: LoadWorldQuery) -> Answer:
        """Load a world, which is read and checked outside of the loop that steps."""
        source = WorldSource(query.uri, "" if query.uri else query.text)
        scenario = scenario_in(self._run.first_scenario, source)
        scenario = distinct(scenario, self._run.known_worlds())

        def now() -> Answer:
            self._refuse_while_restoring()
            self._run.load(scenario, source)
            return self._now(world=self._world())

        return self._run.between_ticks(now, seconds=LOADING_SECONDS)

    def _unload(self) -> Answer:
        self._refuse_while_restoring()
        self._world()
        self._run.load(without_world(self._run.first_scenario), WorldSource())
        return self._now()

    def _present_view(self) -> WorldView:
        """Return the present world, which is built outside of the loop that steps."""
        episode = self._run.episode
        scenario, groups = self._run.between_ticks(
            lambda: (episode.scenario, dict(episode.entities.groups))
        )
        return self._view_of(scenario, groups)

    def _view_of(self, scenario: Scenario, groups: Mapping[str, SolidGroup]) -> WorldView:
        view = self._view
        if view is None or view.scenario is not scenario or view.groups != groups:
            view = self._view = WorldView(scenario, dict(groups))
        return view

    def _entities(self, query: EntitiesQuery) -> Answer:
        def now() -> Answer:
            episode = self._run.episode
            if not has_world(episode.scenario):
                if query.name:
                    raise _without_world("incorrect_state")
                return _at(episode, episode.tick, {"entities": []})
            view = self._view_of(episode.scenario, episode.entities.groups)
            names = [_known(query.name, view)] if query.name else view.names()
            motions, accelerations = episode.motions(), episode.accelerations()
            descriptions = episode.entities.descriptions
            found = [
                view.report(
                    name,
                    descriptions.get(name),
                    motions.get(name),
                    accelerations.get(name, STILL),
                )
                for name in names
            ]
            return _at(episode, episode.tick, {"entities": found})

        self._present_view()
        return self._run.between_ticks(now)

    def _spawn(self, query: SpawnQuery) -> Answer:
        found = resource(query.uri, query.text)
        self._present_view()
        return self._run.between_ticks(lambda: self._spawn_now(query, found))

    def _change(self, query: RemoveQuery | PlaceQuery | DescribeQuery | ResetQuery) -> Answer:
        """Change something between two ticks."""
        self._refuse_changes()
        episode = self._run.episode
        view = self._view_of(episode.scenario, episode.entities.groups)
        match query:
            case RemoveQuery(name=name):
                static = view.statics.get(_known(name, view))
                self._run.change(Remove(name, (name,) if static is None else static.parts))
            case PlaceQuery():
                self._place(query, view)
            case DescribeQuery():
                description = EntityDescription(
                    category=query.category, description=query.description, tags=query.tags
                )
                episode.describe(_known(query.name, view), description)
            case ResetQuery(scopes=scopes):
                return self._reset(frozenset(scopes))
        return self._changed()

    def _refuse_changes(self) -> None:
        """Refuse a change while a saved run is restored, or without a world."""
        self._refuse_while_restoring()
        if not has_world(self._run.episode.scenario):
            raise _without_world("incorrect_state")

    def _refuse_while_restoring(self) -> None:
        try:
            self._run.refuse_while_restoring()
        except UserError as problem:
            raise QueryRefused("incorrect_state", str(problem)) from None

    def _changed(self, **content: object) -> Answer:
        """Return an answer about the tick from which a change is in effect."""
        episode = self._run.episode
        return _at(episode, episode.tick + 1, content)

    def _spawn_now(self, query: SpawnQuery, found: SpawnResource) -> Answer:
        self._refuse_changes()
        episode = self._run.episode
        view = self._view_of(episode.scenario, episode.entities.groups)
        name = _new_name(query, found.name, view)
        pose = self._pose(query.frame, query.position_m, query.orientation, view)
        x, y, z = pose[0]
        try:
            ground_m = view.checks.height_at(x, y)
            base_m = max((v.model.base_height_m for v in found.content.vehicles), default=0.0)
            above_m, yaw = max(0.0, z - ground_m - base_m), degrees(heading_rad(pose[1]))
            more = placed(found.content, name, SpawnPlace(x, y, above_m, yaw), view.checks.ground)
            if query.namespace:
                more = in_namespace(more, query.namespace)
            group = None
            if more.solids:
                parts = tuple(solid.name for solid in more.solids)
                stands = upright(x, y, ground_m + above_m, yaw)
                group = SolidGroup(name, parts, *stands, found.category)
            self._run.change(Spawn(more, group))
        except QueryRefused:
            raise
        except UserError as problem:
            raise QueryRefused("invalid_pose", str(problem)) from None
        if _tilt(pose[1]) > UPRIGHT:
            leaning = (x, y, ground_m + above_m + base_m), pose[1]
            try:
                view = self._view_of(episode.scenario, episode.entities.groups)
                self._set_motion(_known(name, view), leaning, None, view)
            except QueryRefused:
                self._run.change(Remove(name, tuple(more.names())))
                raise
        return self._changed(name=name)

    def _pose(
        self, frame: str, position_m: Vector3, orientation: Quaternion, view: WorldView
    ) -> Pose:
        """Return a pose of a frame in the world."""
        length = sqrt(sum(part * part for part in orientation))
        if not abs(length - 1.0) < UNIT:
            raise QueryRefused(
                "invalid_pose",
                f"the orientation has length {length:g}; expected a unit quaternion x, y, z, w",
            )
        x, y, z, w = (part / length for part in orientation)
        pose: Pose = (position_m, (x, y, z, w))
        if frame not in ("", "world"):
            pose = composed(self._pose_of(_known(frame, view), view), pose)
        if not all(isfinite(part) and abs(part) < FARTHEST_M for part in pose[0]):
            raise QueryRefused(
                "invalid_pose",
                f"the position {', '.join(f'{part:g}' for part in pose[0])} is not in this world. "
                "Fix: choose another place",
            )
        return pose

    def _pose_of(self, name: str, view: WorldView) -> Pose:
        motions = self._run.episode.motions()
        return motions[name][0] if name in motions else view.statics[name].pose

    def _place(self, query: PlaceQuery, view: WorldView) -> None:
        name = _known(query.name, view)
        pose, twist = None, None
        if query.position_m is not None or query.orientation is not None:
            position, orientation = self._pose_of(name, view)
            if query.frame not in ("", "world"):
                frame = self._pose_of(_known(query.frame, view), view)
                position, orientation = relative((position, orientation), frame)
            pose = self._pose(
                query.frame,
                position if query.position_m is None else query.position_m,
                orientation if query.orientation is None else query.orientation,
                view,
            )
        if query.linear_mps is not None or query.angular_radps is not None:
            motions = self._run.episode.motions()
            linear, angular = motions[name][1] if name in motions else STILL
            twist = (query.linear_mps or linear, query.angular_radps or angular)
        self._set_motion(name, pose, twist, view)

    def _set_motion(
        self, name: str, pose: Pose | None, twist: Twist | None, view: WorldView
    ) -> None:
        """Set pose and velocity of an entity; None: unchanged."""
        episode = self._run.episode
        if (actor := view.actors.get(name)) is not None and not is_free(actor):
            raise QueryRefused(
                "failed",
                f"`{name}` moves on a script and cannot be placed. Fix: remove it, and spawn it "
                "elsewhere",
            )
        if (static := view.statics.get(name)) is not None:
            if twist is not None and twist != STILL:
                raise QueryRefused(
                    "failed", f"`{name}` is static and cannot move. Fix: set its pose only"
                )
            if pose is not None:
                self._run.change(_move(static, pose, view))
            return
        if pose is not None:
            try:
                pose = view.checks.on_ground(view.parts[name], pose)
                view.checks.check(name, view.bodies(name), pose, episode.moving())
            except UserError as problem:
                raise QueryRefused("invalid_pose", str(problem)) from None
        episode.place(name, pose, twist)

    def _reset(self, scopes: frozenset[Scope]) -> Answer:
        run = self._run
        match sorted(scopes):
            case ["spawned", "state", "time"]:
                run.reset_all()
                return self._now()
            case ["state", "time"]:
                run.reset()
                return self._now()
            case ["spawned", "state"]:
                self._remove_spawned()
                run.reset_state()
            case ["state"]:
                run.reset_state()
            case ["spawned"]:
                self._remove_spawned()
            case _:
                raise QueryRefused(
                    "unsupported",
                    "time cannot be reset alone. Fix: reset all, time and state, state, or what "
                    "was spawned",
                )
        return self._changed()

    def _remove_spawned(self) -> None:
        """Remove all that the world was not loaded with, and forget descriptions."""
        episode = self._run.episode
        began = {*_names(self._run.as_loaded)}
        if spawned := tuple(name for name in _names(episode.scenario) if name not in began):
            self._run.change(Remove("what was spawned", spawned))
        for name in [*episode.entities.descriptions]:
            episode.describe(name, None)


def _without_world(code: RefusalCode) -> QueryRefused:
    return QueryRefused(code, "no world is loaded. Fix: load one")


def _at(episode: Episode, tick: int, content: Mapping[str, object]) -> Answer:
    stamp_nanos = episode.epoch_nanos + tick * TICK_NANOS
    return {"tick": tick, "stamp_nanos": stamp_nanos, **content}


def _known(name: str, view: WorldView) -> str:
    """Return the name of an entity.

    Raises
    ------
    QueryRefused
        when there is none of this name.
    """
    names = view.names()
    if name not in names:
        near = get_close_matches(name, names, n=1)
        hint = f"did you mean `{near[0]}`?" if near else "Fix: choose one of the list of entities"
        raise QueryRefused("not_found", f"no entity `{name}`; {hint}")
    return name


def _names(scenario: Scenario) -> list[str]:
    """Return the names of all vehicles, actors and static solids."""
    vehicles = (vehicle.name for vehicle in scenario.vehicles)
    actors = (actor.name for actor in scenario.world.actors)
    return [*vehicles, *actors, *(solid.name for solid in solids(scenario))]


def _new_name(query: SpawnQuery, own: str, view: WorldView) -> str:
    """Return the name of an entity that is to be spawned."""
    name = query.name or own
    taken = [*view.names(), *_names(view.scenario), *RESERVED_NAMES]
    if query.allow_renaming:
        name = re.sub(r"^[^a-z]+|[^a-z0-9_]", "_", name.lower()).lstrip("_0123456789") or own
        return free_name(name, taken)
    if not NAME.fullmatch(name) or name in RESERVED_NAMES:
        raise QueryRefused(
            "name_invalid",
            f"`{name}` cannot be a name; expected lower case letters, digits and underscores, a "
            "letter first, and no key of the bus. Fix: rename it, or allow renaming",
        )
    if name in taken:
        raise QueryRefused(
            "name_taken", f"the name `{name}` is taken. Fix: choose another one, or allow renaming"
        )
    return name


def _move(static: StaticEntity, pose: Pose, view: WorldView) -> Move:
    """Return the change that moves a static entity."""
    built = {solid.name: solid for solid in view.checks.solids}
    poses = {part: moved_pose(built[part], static.pose, pose) for part in static.parts}
    return Move(static.name, *pose, poses)


def _tilt(orientation: Quaternion) -> float:
    """Return the sine of the angle between the z axis of a pose and up."""
    x, y, _ = matrix_from_quaternion(orientation)[:, 2].tolist()
    return hypot(x, y)
