# SPDX-License-Identifier: Apache-2.0
"""Resolved scenario: every reference is followed and every default is filled in.

The types alone define what is allowed. Defaults are defined here and scenario files override them.
The resolved scenario is saved with each run's report. Quantities are in the units of data sheets,
which field names state; the code that uses them converts them.
"""

from __future__ import annotations

from math import isfinite, isinf
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import UNSET, Meta, UnsetType, field
from msgspec.structs import force_setattr, replace

from groundlink.core.clock import NANOS, TICK_RATE_HZ, exact
from groundlink.core.fields import Positive, Spec, Vector3
from groundlink.world.actors import Actor, EntityDescription
from groundlink.world.cover import GrassArea, WaterArea
from groundlink.world.objects.indoor_specs import Clutter, Furniture, Room
from groundlink.world.objects.outdoor_specs import OutdoorObject
from groundlink.world.solids import Material, Solid
from groundlink.world.terrain import RoughnessClass, Terrain
from groundlink.world.weather import Lamps, Sun, Weather

from .every_sensor import FramePrefix, Name, RosTopic, SensorSpec
from .expectations import Expectation
from .ros_side import (
    BodyPoses,
    FromRos,
    GatewaySettings,
    GroundTruth,
    RosNode,
    Stream,
    TfTree,
    TrueMap,
)
from .route import Route
from .sensor_kinds import sensor_union
from .vehicle import Effect, Payload, Towing, VehicleModel

Sensor: TypeAlias = SensorSpec
"""A sensor of any installed kind, identified by its tag. Type checkers see the fields that all
kinds share."""

if not TYPE_CHECKING:
    Sensor = sensor_union()

RESERVED_NAMES = frozenset(
    "ack assets bodies clock control faults gaps health journal link scenario state true_map "
    "world".split()
)
"""Second parts of the bus's own keys. Vehicles cannot have these names."""

RESERVED_SENSOR_NAMES = frozenset({"command", "driver", "from_ros", "ground_truth", "vitals"})
"""Last parts of a vehicle's own keys, and the name of its driver. Sensors cannot have these names.
"""

ACKS_PER_WINDOW = 8
"""Number of progress reports of a sensor while physics advances by one lockstep window."""

NAMESPACE = r"^(/[A-Za-z0-9_]+)*$"


class Datum(Spec, frozen=True):
    """Position of the world's origin on the Earth (WGS 84); its axes point east, north and up."""

    latitude_deg: Annotated[float, Meta(ge=-90, le=90)]
    """Geodetic latitude, north positive."""

    longitude_deg: Annotated[float, Meta(ge=-180, le=180)]
    """Longitude, east positive."""

    altitude_m: float = 0.0
    """Height above the ellipsoid."""

    geoid_m: float = 0.0
    """Height of the geoid above the ellipsoid. Maps and NMEA sentences give altitudes above the
    geoid."""


class PoseBox(Spec, frozen=True, kw_only=True):
    """Free space around a named pose, a box in the frame of the pose."""

    low_m: Vector3
    """Lowest corner of the box."""

    high_m: Vector3
    """Highest corner of the box."""


class NamedPose(Spec, frozen=True, kw_only=True):
    """A pose in the world that tools know by name, such as a parking place or a goal."""

    position_m: Vector3
    """Position in the world."""

    yaw_deg: float = 0.0
    """Heading, counterclockwise from the world's x axis."""

    description: str = ""
    """Description for people."""

    tags: tuple[str, ...] = ()
    """Tags by which tools select poses, such as `spawn`, `parking` or `goal`."""

    box: PoseBox | None = None
    """Free space around the pose; none: not stated."""


class World(Spec, frozen=True, kw_only=True):
    """Static world and moving actors around the vehicles."""

    name: Name
    """Name of the world."""

    datum: Datum | None = None
    """Geographic position of the world; none: satellites cannot be received."""

    materials: dict[str, Material] = field(default_factory=dict)
    """Materials by name. Everything in the world refers to them. A name that neither the world nor
    a vehicle defines has the properties that the library of materials gives it."""

    room: Room | None = None
    """Room around the origin; none: an open world."""

    furniture: tuple[Furniture, ...] = ()
    """Furniture on the floor."""

    outdoors: tuple[OutdoorObject, ...] = ()
    """Houses, fences, plants. Includes the objects that a file's `scatter` places."""

    solids: tuple[Solid, ...] = ()
    """Single static shapes, for objects that no kind of furniture describes."""

    actors: tuple[Actor, ...] = ()
    """Bodies that move along a path, or when they are pushed."""

    terrain: Terrain | None = None
    """Terrain; none: the only ground is that of the room and of solids."""

    water: Annotated[tuple[WaterArea, ...], Meta(max_length=16)] = ()
    """Standing water on the terrain, through which vehicles wade."""

    grass: Annotated[tuple[GrassArea, ...], Meta(max_length=16)] = ()
    """Tall grass on the terrain, through which LiDARs see in part."""

    clutter: Clutter | None = None
    """Boxes and cans at random places in the room; none: no clutter."""

    checkpoints: dict[Name, tuple[float, float]] = field(default_factory=dict)
    """Positions on the floor, x and y in meters, at which errors are evaluated. The report gives
    the time at which each was passed."""

    light: Sun | Lamps | None = None
    """Light sources; none: a lamp in the center of the room's ceiling, or the sun if there is no
    room."""

    weather: Weather = Weather()
    """Fog, rain and dust; default: clear and dry."""

    roughness: RoughnessClass | dict[str, RoughnessClass] | None = None
    """Roughness of the ground that wheels feel, by the classes A (smooth road) to H of ISO 8608:
    one class for all ground, or classes by material. None: smooth. Sensors do not see it."""

    description: str = ""
    """Description for people."""

    tags: tuple[str, ...] = ()
    """Tags by which tools select worlds, such as `indoor`."""

    poses: dict[Name, NamedPose] = field(default_factory=dict)
    """Named poses by name, such as parking places."""

    entities: dict[str, EntityDescription] = field(default_factory=dict)
    """Descriptions of actors, solids, furniture and vehicles for tools, by name."""

    @property
    def ground_materials(self) -> tuple[str, ...]:
        """Materials of the terrain by number, then of each area of water and of grass."""
        if self.terrain is None:
            return ()
        water = (area.material for area in self.water)
        grass = (area.material for area in self.grass)
        return (*self.terrain.materials, *water, *grass)

    @property
    def sun(self) -> Sun | None:
        """The sun, which lights worlds without a room by default; None if lamps do."""
        if self.light is None:
            return Sun() if self.room is None else None
        return self.light if isinstance(self.light, Sun) else None


class Placement(Spec, frozen=True):
    """Spawn place of a vehicle: its base footprint on the ground, in the world frame."""

    x_m: float = 0.0
    """Position along the world's x axis (east)."""

    y_m: float = 0.0
    """Position along the world's y axis (north)."""

    z_m: float = 0.0
    """Height above the ground: the terrain, or z = 0 without terrain."""

    yaw_deg: float = 0.0
    """Heading, counterclockwise from the world's x axis."""


class Vehicle(Spec, frozen=True, kw_only=True):
    """A vehicle of a run."""

    name: Name
    """Name of the vehicle, unique in the run. Part of its keys on the bus."""

    model: VehicleModel
    """Bodies, wheels and drive. A file may give the name of a vehicle file instead."""

    placement: Placement = Placement()
    """Spawn place; default: the world's origin, or behind the vehicle of `towed_by`."""

    towed_by: Towing | UnsetType = UNSET
    """Hitch to another vehicle; none: it moves on its own."""

    namespace: Annotated[str, Meta(pattern=NAMESPACE)] = ""
    """Namespace of topics that do not begin with a slash: `/name` if a run has several vehicles."""

    command_topic: RosTopic = "/cmd_vel"
    """ROS topic of the velocity commands."""

    command_type: Literal["Twist", "TwistStamped"] = "Twist"
    """geometry_msgs type that the stack publishes on that topic. Stamps are ignored: a command acts
    when it arrives."""

    frame_prefix: FramePrefix = ""
    """Prefix of the vehicle's frame names: `name/` if several vehicles share a tf tree."""

    tf: TfTree = TfTree()
    """Transforms that the gateway publishes, beside the sensor mounts."""

    sensors: tuple[Sensor, ...] = ()
    """Sensors of the vehicle. `kind` selects the kind of each."""

    streams: tuple[Stream, ...] = ()
    """Streams of other processes that the gateway carries to ROS."""

    ground_truth: GroundTruth = GroundTruth()
    """Ground truth of the vehicle, for evaluation."""

    from_ros: FromRos = FromRos()
    """ROS topics of the vehicle's stack that the gateway publishes on the bus."""

    route: Route | None = None
    """Route of the autopilot; none: the vehicle waits for commands."""

    effects: tuple[Effect, ...] = ()
    """Effects of the model that act. Each is a field of the model, which has its figures."""

    payload: tuple[Payload, ...] | UnsetType = UNSET
    """Loads on the vehicle: they add to its mass and inertia, shift its center of mass and press
    its springs; none: the model's own mass."""

    tire_pressure_pa: Positive | UnsetType = UNSET
    """Pressure of all inflated tires, as a central tire inflation sets it; none: the `inflation` of
    each wheel."""

    def __post_init__(self) -> None:
        self.model.with_effects(self.effects)
        if self.tire_pressure_pa and not any(wheel.inflation for wheel in self.model.wheels):
            raise ValueError(
                f"`tire_pressure_pa`: no wheel of `{self.model.name}` has an `inflation`. Fix: add "
                "`inflation: {pressure_pa: ...}` to the wheels of the model"
            )
        for sensor in self.sensors:
            try:
                self.model.link_of(sensor.mount)
            except ValueError as error:
                raise ValueError(f"`mount.joint` of `{sensor.name}`: {error}") from None
        if not self.from_ros.joint_groups:
            return
        joints = {joint.name: joint.commands for joint in self.model.joint_interfaces()}
        for topic, group in self.from_ros.joint_groups.items():
            for name in group.joints:
                if group.interface not in joints.get(name, ()):
                    known = ", ".join(n for n in joints if group.interface in joints[n]) or "none"
                    raise ValueError(
                        f"`from_ros.joint_groups`: {topic}: no joint `{name}` takes commands of "
                        f"`{group.interface}`; expected one of {known}"
                    )

    @property
    def takes_joint_commands(self) -> bool:
        """Whether ROS commands the vehicle's joints, and so needs the states of all of them."""
        return self.from_ros.joints is not None or bool(self.from_ros.joint_groups)

    @property
    def true_joints(self) -> tuple[str, ...]:
        """Names of the joints in the ground truth of joints, without wheels."""
        steering = self.model.drive.steering_joints if self.takes_joint_commands else ()
        return (*self.model.moving_names, *steering)


FIXED_EPOCH_NANOS = 1_000_000_000 * NANOS
"""Epoch of runs that do not follow the wall clock: 2001-09-09 01:46:40 UTC. Sim time can be read
from the digits of a stamp. A stamp of 0 is unsuitable, since tf reads it as "the newest". A date
in the past cannot be mistaken for the date of the recording."""


DEFAULT_ANSWERS = {"/cmd_vel": "/clock"}


class Time(Spec, frozen=True):
    """Clock of a run: mode, lockstep participants, and epoch of the stamps."""

    mode: Literal["realtime", "fast", "lockstep"] = "realtime"
    """`realtime`: sim time follows the wall clock. `lockstep`: physics does not step before all
    participants have followed, and follows the wall clock as far as that allows. `fast`:
    lockstep without a wall clock."""

    lockstep: Literal["sensors", "ros"] = "sensors"
    """Participants in lockstep and fast mode, besides drivers: the sensors, or the sensors and ROS.
    """

    factor: Annotated[float, Meta(gt=0)] = 1.0
    """Sim seconds per second of the wall clock, in realtime and lockstep mode."""

    overload: Literal["slow", "skip", "fail"] = "slow"
    """Reaction if a process cannot keep up. `slow`: sim time slows down. `skip`: readings are left
    out and marked as missing. `fail`: the run ends."""

    deadline_s: Annotated[float, Meta(gt=0)] = 5.0
    """Wall time for which a process may delay the run before it is reported and before `overload`
    acts."""

    catch_up: Annotated[float, Meta(ge=0, le=0.05)] = 0.05
    """Realtime mode: how much faster than `factor` sim time runs after a stall, as a fraction,
    until stamps match the wall clock again. With 0 they stay behind."""

    epoch: Literal["wall", "fixed", "zero"] | None = None
    """Stamp of sim time zero. `wall`: the wall clock at the start. `fixed`: 1,000,000,000 s.
    `zero`: 0. Default: `wall` in realtime mode, otherwise `fixed`."""

    clock_rate_hz: Annotated[float, Meta(gt=0, le=400)] = 100.0
    """Messages on `/clock` per second of sim time."""

    window_ticks: Annotated[int, Meta(ge=8)] = 400
    """Largest lead of physics over the slowest process that it waits for. At least a period of the
    clock, since gateway and recorder report their progress with each clock message."""

    checkpoint_s: Annotated[float, Meta(ge=0.5, le=60)] | None = None
    """Sim time between checkpoints, from which `seek` continues a recorded run. Default: none. At
    a checkpoint physics rebuilds all that moves, which changes the last digits of the motion."""

    answers: dict[RosTopic, RosTopic] = field(default_factory=DEFAULT_ANSWERS.copy)
    """With `lockstep: ros`: each key is a topic on which ROS answers, and its value the topic that
    it answers, one message for each message. Sim time advances after the answers."""

    nodes: tuple[RosNode, ...] = ()
    """With `lockstep: ros`, instead of `answers`: the nodes of a graph in ROS. The messages of an
    instant are published one at a time, each after all nodes have answered the one before."""

    def __post_init__(self) -> None:
        if self.nodes and self.answers not in ({}, DEFAULT_ANSWERS):
            raise ValueError("`answers` and `nodes` are both given. Fix: keep one")
        if isinf(self.factor):
            raise ValueError("`factor` is infinite. Fix: use `mode: fast`, which has no pace")
        if not isfinite(self.deadline_s):
            raise ValueError(
                f"`deadline_s` is {self.deadline_s}; expected finite seconds, such as 5.0; with "
                "`overload: slow`, lockstep has no deadline"
            )
        if self.lockstep == "ros":
            if self.mode == "realtime":
                raise ValueError(
                    "`lockstep: ros` waits for ROS, but `mode: realtime` never waits. Fix: use "
                    "`mode: lockstep` or `fast`, or omit `lockstep`"
                )
            if (TICK_RATE_HZ / exact(self.clock_rate_hz)).denominator > 1:
                raise ValueError(
                    "`lockstep: ros` steps from one clock message to the next, which needs "
                    f"a `clock_rate_hz` that divides {TICK_RATE_HZ}, such as 50, 100 or 200"
                )

    @property
    def epoch_nanos(self) -> int | None:
        """Return the stamp of sim time zero; None for the wall clock at the start."""
        match self.epoch or ("wall" if self.mode == "realtime" else "fixed"):
            case "wall":
                return None
            case "fixed":
                return FIXED_EPOCH_NANOS
            case _:
                return 0

    @property
    def waits(self) -> bool:
        """Whether physics waits for sensors that are behind, so that no readings are left out."""
        return self.mode != "realtime" or self.overload != "skip"

    @property
    def ack_ticks(self) -> int:
        """Period in ticks at which sensors report progress.

        The gateway sends the messages of an instant to ROS after all sensors have passed it.
        """
        if self.lockstep == "ros":
            return int(TICK_RATE_HZ / exact(self.clock_rate_hz))
        return self.window_ticks // ACKS_PER_WINDOW


class Scenario(Spec, frozen=True, kw_only=True):
    """A run: seed, world, vehicles with their sensors, and the ROS side."""

    name: Name
    """Name of the run, part of its keys on the bus."""

    description: str = ""
    """Description for people; the report shows it."""

    seed: Annotated[int, Meta(ge=0)] = 0
    """Seed of all random numbers: noise of the sensors, clutter, scattered objects."""

    time: Time = Time()
    """Clock of the run: mode, participants in lockstep, reaction to overload, epoch."""

    world: World
    """World around the vehicles. A file may give the name of a world file instead."""

    vehicles: tuple[Vehicle, ...]
    """Vehicles of the run, each with its sensors."""

    bodies: BodyPoses = BodyPoses()
    """True poses of all bodies for evaluation, moving and static."""

    true_map: TrueMap | None = None
    """True occupancy map for localization and its evaluation; none: it is not published."""

    gateway: GatewaySettings = GatewaySettings()
    """Settings of the gateway to ROS."""

    expect: tuple[Expectation, ...] = ()
    """Conditions that a run of the scenario passes or fails. `kind` selects the kind of each."""

    def __post_init__(self) -> None:
        starts: dict[str, Placement] = {}
        for vehicle in self.vehicles:
            starts[vehicle.name] = vehicle.placement
            if (hitch := vehicle.towed_by) and (by := starts.get(hitch.vehicle)):
                x, y, yaw_deg = hitch.behind(by.x_m, by.y_m, by.yaw_deg)
                starts[vehicle.name] = Placement(x, y, by.z_m, yaw_deg)
        placed = (replace(v, placement=starts[v.name]) if v.towed_by else v for v in self.vehicles)
        force_setattr(self, "vehicles", tuple(placed))

    def sensor(self, name: str) -> tuple[Vehicle, SensorSpec] | None:
        """Return the vehicle and the sensor named `vehicle/sensor`, or None."""
        for vehicle in self.vehicles:
            for sensor in vehicle.sensors:
                if f"{vehicle.name}/{sensor.name}" == name:
                    return vehicle, sensor
        return None

    def with_only(self, name: str) -> Scenario:
        """Return the scenario with the sensor named `vehicle/sensor` as its only one."""
        vehicles = (
            replace(v, sensors=tuple(s for s in v.sensors if f"{v.name}/{s.name}" == name))
            for v in self.vehicles
        )
        return replace(self, vehicles=tuple(vehicles))

    def ground_truth_topic(self, vehicle: Vehicle) -> str:
        """Return the ROS topic of a vehicle's true odometry."""
        return vehicle.ground_truth.topic or f"{vehicle.namespace}/ground_truth/odom"

    def true_wheels_topic(self, vehicle: Vehicle) -> str:
        """Return the ROS topic of a vehicle's true wheel states."""
        return vehicle.ground_truth.wheels_topic or f"{vehicle.namespace}/ground_truth/wheels"

    def true_joints_topic(self, vehicle: Vehicle) -> str:
        """Return the ROS topic of the true positions of a vehicle's joints other than wheels."""
        return vehicle.ground_truth.joints_topic or f"{vehicle.namespace}/ground_truth/joints"

    def true_topics(self, vehicle: Vehicle) -> list[str]:
        """Return the ROS topics of a vehicle's ground truth."""
        joints = [self.true_joints_topic(vehicle)] if vehicle.true_joints else []
        return [self.ground_truth_topic(vehicle), self.true_wheels_topic(vehicle), *joints]

    def vitals_topic(self, vehicle: Vehicle) -> str:
        """Return the topic of a vehicle's vitals in a recording."""
        return f"{vehicle.namespace}/vitals"

    def sensor_names(self) -> list[str]:
        """Return all sensors as `vehicle/sensor`, in the order of the scenario."""
        return [f"{v.name}/{s.name}" for v in self.vehicles for s in v.sensors]


__all__ = ["Placement", "Scenario", "Time", "Vector3", "Vehicle", "World"]
