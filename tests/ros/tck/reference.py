# SPDX-License-Identifier: Apache-2.0
"""A simulator of `simulation_interfaces` 2.1 in plain rclpy that keeps entities in a dict.

It has no physics: an entity is a cube where it was put. Every request, response, feedback and
result passes `change`, by which a test makes the simulator violate the standard.
"""

import copy
import math
import re
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, Twist, Vector3
from rclpy.action.server import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from simulation_interfaces import srv
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import (
    Bounds,
    EntityCategory,
    EntityInfo,
    EntityState,
    NamedPose,
    Resource,
    Result,
    SimulationState,
    SimulatorFeatures,
    Spawnable,
    SpawnResult,
    TagsFilter,
    WorldResource,
)

from simulation_interfaces_tck.features import CODES

OK = Result.RESULT_OK
NOT_FOUND = Result.RESULT_NOT_FOUND
FAILED = Result.RESULT_OPERATION_FAILED
UNSUPPORTED = Result.RESULT_FEATURE_UNSUPPORTED
STOPPED = SimulationState.STATE_STOPPED
PLAYING = SimulationState.STATE_PLAYING
PAUSED = SimulationState.STATE_PAUSED
NO_WORLD = SimulationState.STATE_NO_WORLD
STATIC = EntityCategory.CATEGORY_STATIC_OBJECT

HALF_M = 0.2
STEP_NANOS = 10_000_000
NAME = re.compile(r"\w+")
NAMESPACE = re.compile(r"(/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*)?")
CHARACTER_CLASSES = {"[:digit:]": "0-9", "[:alpha:]": "A-Za-z", "[:alnum:]": "A-Za-z0-9"}
SPAWNABLES = {"toy:box": EntityCategory.CATEGORY_DYNAMIC_OBJECT, "toy:pillar": STATIC}
"""Category of each resource."""


class Refused(Exception):
    """A result other than RESULT_OK."""

    def __init__(self, code: int, message: str = "refused") -> None:
        super().__init__(message)
        self.code = code


@dataclass
class Entity:
    """A cube."""

    start: Pose
    category: int = 0
    is_spawned: bool = True
    state: EntityState = field(default_factory=EntityState)
    info: EntityInfo = field(default_factory=EntityInfo)

    def __post_init__(self) -> None:
        self.reset()
        self.info.category.category = self.category

    def reset(self) -> None:
        self.state = EntityState(pose=copy.deepcopy(self.start))

    def gap(self, center: Point) -> tuple[float, float, float]:
        """Return how far a point is from the cube along each axis."""
        at = self.state.pose.position
        return (
            max(0.0, abs(center.x - at.x) - HALF_M),
            max(0.0, abs(center.y - at.y) - HALF_M),
            max(0.0, abs(center.z - at.z) - HALF_M),
        )

    def overlaps(self, bounds: Bounds) -> bool:
        if bounds.type == Bounds.TYPE_EMPTY:
            return True
        if bounds.type == Bounds.TYPE_SPHERE:
            return math.hypot(*self.gap(bounds.points[0])) <= bounds.points[1].x
        at = self.state.pose.position  # a hull counts as the box around it
        return all(
            min(getattr(p, axis) for p in bounds.points) - HALF_M
            <= getattr(at, axis)
            <= max(getattr(p, axis) for p in bounds.points) + HALF_M
            for axis in "xyz"
        )


def has_tags(tags: Collection[str], wanted: TagsFilter) -> bool:
    match = all if wanted.filter_mode == TagsFilter.FILTER_MODE_ALL else any
    return not wanted.tags or match(tag in tags for tag in wanted.tags)


def is_valid(pose: Pose) -> bool:
    q, at = pose.orientation, pose.position
    numbers = (q.x, q.y, q.z, q.w, at.x, at.y, at.z)
    return all(map(math.isfinite, numbers)) and math.isclose(
        math.hypot(*numbers[:4]), 1.0, abs_tol=1e-3
    )


class ReferenceSimulator:
    """The simulator, active until `close`.

    Parameters
    ----------
    folder
        Where the files of its worlds are written.
    features
        Names of the features that it announces.
    served
        Names of the services and the action that it serves; none: all.
    """

    def __init__(
        self,
        folder: Path,
        namespace: str = "",
        features: Iterable[str] = tuple(CODES),
        served: Collection[str] = (),
    ) -> None:
        self.features = [*features]
        self.worlds = []
        for name in ("hall", "yard"):
            file = folder / f"{name}.toyworld"
            file.write_text(f"world {name}\n", encoding="utf-8")
            resource = Resource(uri=file.as_uri())
            tags = ["tck", name]
            self.worlds.append(WorldResource(name=name, world_resource=resource, tags=tags))
        self.start()
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node(
            "reference",
            context=self.context,
            namespace=namespace,
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        for name in filter(str.isalpha, vars(srv)):
            if not name.startswith("Event") and (not served or name in served):
                self._serve(getattr(srv, name), name)
        if not served or "SimulateSteps" in served:
            self._serve_action()
        self._clock = self.node.create_publisher(Clock, "/clock", 1)
        self.node.create_timer(0.01, self._tick)
        self._executor = MultiThreadedExecutor(2, context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def start(self) -> None:
        """Begin as at first, and adhere to the standard."""
        self.change: Callable[[Any], None] = lambda message: None
        self.state, self.nanos = PLAYING, 0
        self.world: WorldResource | None = self.worlds[0]
        self._build()

    def close(self) -> None:
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _serve(self, kind: Any, name: str) -> None:
        snake = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
        handler = getattr(self, snake)
        self.node.create_service(kind, snake, partial(self._answer, handler))

    def _answer(self, handler: Callable[[Any, Any], None], request: Any, response: Any) -> Any:
        self.change(request)
        if hasattr(response, "result"):
            response.result.result = OK
        try:
            handler(request, response)
        except Refused as reason:
            response.result = Result(result=reason.code, error_message=str(reason))
        self.change(response)
        return response

    def _build(self) -> None:
        """Put what belongs to the world into it."""
        self.entities: dict[str, Entity] = {
            "wall": Entity(Pose(position=Point(y=50.0)), STATIC, is_spawned=False)
        }

    def _tick(self) -> None:
        if self.state == PLAYING:
            self.nanos += STEP_NANOS
        self._clock.publish(Clock(clock=self._stamp()))

    def _stamp(self) -> Time:
        seconds, nanos = divmod(self.nanos, 10**9)
        return Time(sec=seconds, nanosec=nanos)

    def entity(self, name: str) -> Entity:
        if name not in self.entities:
            raise Refused(NOT_FOUND, f"no entity {name!r}")
        return self.entities[name]

    # -- features and entities --------------------------------------------------------------------

    def get_simulator_features(self, _: Any, response: Any) -> None:
        codes = [CODES[name] for name in self.features]
        response.features = SimulatorFeatures(features=codes, spawn_formats=["toy", "urdf"])

    def spawn_entity(self, request: Any, response: Any) -> None:
        response.entity_name = self._spawn(request)

    def spawn_entities(self, request: Any, response: Any) -> None:
        for wanted in request.spawn_requests:
            try:
                spawned = SpawnResult(result=Result(result=OK), entity_name=self._spawn(wanted))
            except Refused as reason:
                failed = Result(result=reason.code, error_message=str(reason))
                spawned = SpawnResult(result=failed)
                response.result.result = srv.SpawnEntities.Response.ENTITIES_SPAWN_FAILED
            response.results.append(spawned)

    def _spawn(self, request: Any) -> str:
        category, name = self._parse(request.entity_resource)
        name = request.name or name
        if not name and not request.allow_renaming:
            raise Refused(SpawnResult.NAME_INVALID)
        if name and not NAME.fullmatch(name):
            raise Refused(SpawnResult.NAME_INVALID)
        if not NAMESPACE.fullmatch(request.entity_namespace):
            raise Refused(SpawnResult.NAMESPACE_INVALID)
        if request.initial_pose.header.frame_id not in ("", "world"):
            raise Refused(FAILED, "unknown frame")
        if not is_valid(request.initial_pose.pose):
            raise Refused(SpawnResult.INVALID_POSE)
        full = "/".join(filter(None, (request.entity_namespace, name or "entity")))
        if full in self.entities:
            if not request.allow_renaming:
                raise Refused(SpawnResult.NAME_NOT_UNIQUE)
            full = next(f"{full}_{i}" for i in range(99) if f"{full}_{i}" not in self.entities)
        self.entities[full] = Entity(request.initial_pose.pose, category)
        return full

    def _parse(self, resource: Resource) -> tuple[int, str]:
        """Return category and name of a resource."""
        text = resource.resource_string
        if resource.uri in SPAWNABLES:
            return SPAWNABLES[resource.uri], ""
        if resource.uri:
            file = Path(urlparse(resource.uri).path)
            if file.suffix != ".urdf":
                raise Refused(SpawnResult.UNSUPPORTED_FORMAT)
            text = file.read_text(encoding="utf-8")
        if not text:
            raise Refused(SpawnResult.NO_RESOURCE)
        try:
            return 0, ElementTree.fromstring(text).get("name", "")
        except ElementTree.ParseError as reason:
            raise Refused(SpawnResult.RESOURCE_PARSE_ERROR, str(reason)) from None

    def delete_entity(self, request: Any, _: Any) -> None:
        self.entity(request.entity)
        del self.entities[request.entity]

    def get_entities(self, request: Any, response: Any) -> None:
        response.entities = self._matching(request.filters)

    def get_entities_states(self, request: Any, response: Any) -> None:
        response.entities = self._matching(request.filters)
        states = (self.entities[name].state for name in response.entities)
        response.states = [copy.deepcopy(state) for state in states]

    def _matching(self, filters: Any) -> list[str]:
        pattern = filters.filter
        for posix, characters in CHARACTER_CLASSES.items():
            pattern = pattern.replace(posix, characters)
        categories = {wanted.category for wanted in filters.categories}
        return [
            name
            for name, entity in self.entities.items()
            if re.search(pattern, name)
            and (not categories or entity.info.category.category in categories)
            and has_tags(entity.info.tags, filters.tags)
            and entity.overlaps(filters.bounds)
        ]

    def get_entity_state(self, request: Any, response: Any) -> None:
        response.state = copy.deepcopy(self.entity(request.entity).state)
        response.state.header.stamp = self._stamp()

    def set_entity_state(self, request: Any, _: Any) -> None:
        entity, wanted = self.entity(request.entity), request.state
        if request.set_pose and not is_valid(wanted.pose):
            raise Refused(srv.SetEntityState.Response.INVALID_POSE)
        is_moved = (request.set_twist and wanted.twist != Twist()) or (
            request.set_acceleration and wanted.acceleration != EntityState().acceleration
        )
        if is_moved and entity.info.category.category == STATIC:
            raise Refused(FAILED, "a static object does not move")
        for flag, part in (("set_pose", "pose"), ("set_twist", "twist")):
            if getattr(request, flag):
                setattr(entity.state, part, getattr(wanted, part))

    def get_entity_info(self, request: Any, response: Any) -> None:
        response.info = self.entity(request.entity).info

    def set_entity_info(self, request: Any, _: Any) -> None:
        self.entity(request.entity).info = request.info

    def get_entity_bounds(self, request: Any, response: Any) -> None:
        self.entity(request.entity)
        response.bounds = self._cube()

    def _cube(self) -> Bounds:
        corner = Vector3(x=HALF_M, y=HALF_M, z=HALF_M)
        opposite = Vector3(x=-HALF_M, y=-HALF_M, z=-HALF_M)
        return Bounds(type=Bounds.TYPE_BOX, points=[corner, opposite])

    def get_spawnables(self, request: Any, response: Any) -> None:
        response.result.error_message = " ".join(request.sources)
        response.spawnables = [Spawnable(entity_resource=Resource(uri=uri)) for uri in SPAWNABLES]

    def get_named_poses(self, request: Any, response: Any) -> None:
        poses = [NamedPose(name="gate", tags=["spawn"]), NamedPose(name="dock", tags=["parking"])]
        poses.append(NamedPose(name="both", tags=["parking", "spawn"]))
        response.poses = [pose for pose in poses if has_tags(pose.tags, request.tags)]

    def get_named_pose_bounds(self, request: Any, response: Any) -> None:
        if request.name not in ("gate", "dock", "both"):
            raise Refused(NOT_FOUND)
        response.bounds = self._cube()

    # -- the simulation ---------------------------------------------------------------------------

    def get_simulation_state(self, _: Any, response: Any) -> None:
        response.state.state = self.state

    def set_simulation_state(self, request: Any, _: Any) -> None:
        wanted = request.state.state
        if self.state == NO_WORLD or wanted not in (STOPPED, PLAYING, PAUSED):
            raise Refused(srv.SetSimulationState.Response.STATE_TRANSITION_ERROR)
        if wanted == self.state:
            raise Refused(srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE)
        if wanted == STOPPED:
            self._reset(srv.ResetSimulation.Request.SCOPE_ALL)
        self.state = wanted

    def reset_simulation(self, request: Any, _: Any) -> None:
        self._reset(request.scope or srv.ResetSimulation.Request.SCOPE_ALL)

    def _reset(self, scope: int) -> None:
        if scope & srv.ResetSimulation.Request.SCOPE_TIME:
            self.nanos = 0
        if scope & srv.ResetSimulation.Request.SCOPE_STATE:
            for entity in self.entities.values():
                entity.reset()
        if scope & srv.ResetSimulation.Request.SCOPE_SPAWNED:
            kept = {name: it for name, it in self.entities.items() if not it.is_spawned}
            self.entities = kept

    def step_simulation(self, request: Any, _: Any) -> None:
        if self.state != PAUSED:
            raise Refused(FAILED, "not paused")
        self.nanos += request.steps * STEP_NANOS

    def _serve_action(self) -> None:
        self._action = ActionServer(
            self.node,
            SimulateSteps,
            "simulate_steps",
            execute_callback=self._simulate,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def _simulate(self, goal: Any) -> Any:
        result = SimulateSteps.Result(result=Result(result=OK))
        steps = goal.request.steps
        if self.state != PAUSED:
            result.result = Result(result=FAILED, error_message="not paused")
            steps = 0
        for done in range(1, steps + 1):
            if goal.is_cancel_requested:
                goal.canceled()
                break
            self.nanos += STEP_NANOS
            feedback = SimulateSteps.Feedback(completed_steps=done, remaining_steps=steps - done)
            self.change(feedback)
            goal.publish_feedback(feedback)
            if steps > 100:
                time.sleep(0.001)
        self.change(result)
        if result.result.result == OK and goal.is_active:
            goal.succeed()
        elif goal.is_active:
            goal.abort()
        return result

    # -- worlds -----------------------------------------------------------------------------------

    def get_available_worlds(self, request: Any, response: Any) -> None:
        response.worlds = [world for world in self.worlds if has_tags(world.tags, request.filter)]

    def get_current_world(self, _: Any, response: Any) -> None:
        if self.world is None:
            raise Refused(srv.GetCurrentWorld.Response.NO_WORLD_LOADED)
        response.world = self.world

    def load_world(self, request: Any, response: Any) -> None:
        codes = srv.LoadWorld.Response
        resource = request.world_resource
        text = resource.resource_string
        if resource.uri:
            file = Path(urlparse(resource.uri).path)
            if file.suffix != ".toyworld":
                raise Refused(codes.UNSUPPORTED_FORMAT)
            if not file.is_file():
                raise Refused(NOT_FOUND)
            text = file.read_text(encoding="utf-8")
        if not text:
            raise Refused(codes.NO_RESOURCE)
        if not (match := re.fullmatch(r"world (\w+)\n", text)):
            raise Refused(codes.RESOURCE_PARSE_ERROR)
        self.state, self.nanos = STOPPED, 0
        self._build()
        self.world = WorldResource(name=match[1], world_resource=resource)
        response.world = self.world

    def unload_world(self, _: Any, __: Any) -> None:
        if self.world is None:
            raise Refused(srv.UnloadWorld.Response.NO_WORLD_LOADED)
        self.world, self.state = None, NO_WORLD
        self.entities.clear()
