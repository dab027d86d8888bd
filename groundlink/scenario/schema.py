# SPDX-License-Identifier: Apache-2.0
"""A resolved scenario: every reference followed, every default filled in.

Rule: types say what is allowed, and nothing else does. Defaults live here, scenario files override
them, and the resolved scenario is saved with each run's report. Angles and units are those of data
sheets, named in the field; they are converted once, where they are used.
"""

from __future__ import annotations

from math import isfinite, isinf
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta, field
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_RATE_HZ, exact
from groundlink.core.fields import Spec, Vector3
from groundlink.world.actors import Actor
from groundlink.world.light import Lamps, Sun
from groundlink.world.objects.indoor_specs import Clutter, Furniture, Room
from groundlink.world.objects.outdoor_specs import OutdoorObject
from groundlink.world.solids import Material, Solid
from groundlink.world.terrain import Terrain
from groundlink.world.weather import Weather

from .every_sensor import FramePrefix, Name, Rate, RosTopic, SensorSpec
from .ros_side import FromRos, GatewaySettings, Stream, TfTree
from .route import Route
from .sensor_kinds import sensor_union
from .vehicle import VehicleModel

Sensor: TypeAlias = SensorSpec
"""Any installed kind, told apart by its tag. Type checkers see what all kinds share."""

if not TYPE_CHECKING:
    Sensor = sensor_union()

RESERVED_NAMES = frozenset(
    "ack assets bodies clock control faults gaps health journal link scenario state".split()
)
"""Second parts of the bus's own keys, so no names for vehicles."""

RESERVED_SENSOR_NAMES = frozenset({"command", "driver", "from_ros", "ground_truth", "vitals"})
"""Last parts of a vehicle's own keys, and the name of its driver."""

ACKS_PER_WINDOW = 8
"""How often sensors tell their progress while physics gets as far ahead as it may."""

NAMESPACE = r"^(/[A-Za-z0-9_]+)*$"


class Datum(Spec, frozen=True):
    """Where on the Earth (WGS 84) a world's origin is; its axes are east, north and up there."""

    latitude_deg: Annotated[float, Meta(ge=-90, le=90)]
    longitude_deg: Annotated[float, Meta(ge=-180, le=180)]
    altitude_m: float = 0.0
    """Above the ellipsoid."""

    geoid_m: float = 0.0
    """Height of the geoid, by which maps and NMEA count altitude, above the ellipsoid."""


class World(Spec, frozen=True, kw_only=True):
    """What stands around the vehicles."""

    name: Name
    datum: Datum | None = None
    """None: nowhere on the Earth, so satellites cannot be received."""

    materials: dict[str, Material]
    room: Room | None = None
    furniture: tuple[Furniture, ...] = ()
    outdoors: tuple[OutdoorObject, ...] = ()
    """Houses, fences, plants; what a file's `scatter` sows is among them."""

    solids: tuple[Solid, ...] = ()
    """Single static shapes, where no kind of furniture fits."""

    actors: tuple[Actor, ...] = ()
    """Bodies that move by themselves, or when they are pushed."""

    terrain: Terrain | None = None
    """None: no ground but that of room and solids."""

    clutter: Clutter | None = None
    checkpoints: dict[Name, tuple[float, float]] = field(default_factory=dict)
    """Places on the floor, x and y in metres, where errors are looked at; a report tells when each
    was passed."""

    light: Sun | Lamps | None = None
    """None: a lamp amid a room's ceiling, the sun where there is no room."""

    weather: Weather = Weather()


class Placement(Spec, frozen=True):
    """Where a vehicle starts: its base footprint on the ground, in the world."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    """Above the ground there: the terrain, or z = 0 where there is none."""

    yaw_deg: float = 0.0


class GroundTruth(Spec, frozen=True):
    """What physics publishes of a vehicle without error, for comparison and never for a stack."""

    topic: RosTopic | None = None
    """Of the odometry: `ground_truth/odom` in the vehicle's namespace unless given."""

    wheels_topic: RosTopic | None = None
    """Of the wheels' angles, speeds and torques: `ground_truth/wheels`, in the same way."""

    joints_topic: RosTopic | None = None
    """Of positions and speeds of the vehicle's other joints: `ground_truth/joints`, likewise."""

    rate_hz: Rate = 50.0
    push: bool = False


class BodyPoses(Spec, frozen=True):
    """The true poses of all bodies, from physics: what moves and what stands still."""

    topic: RosTopic = "/ground_truth/bodies"
    rate_hz: Rate = 10.0
    """Less than of one vehicle's truth: there may be hundreds of bodies, and most stand still."""

    push: bool = False


class Vehicle(Spec, frozen=True, kw_only=True):
    """One vehicle of a run."""

    name: Name
    model: VehicleModel
    placement: Placement = Placement()
    namespace: Annotated[str, Meta(pattern=NAMESPACE)] = ""
    """Of topics that do not begin with a slash: `/name` where there are several vehicles."""

    command_topic: RosTopic = "/cmd_vel"
    command_type: Literal["Twist", "TwistStamped"] = "Twist"
    """What the stack publishes there, both of geometry_msgs; a stamp is not looked at, as a command
    acts when it comes."""

    frame_prefix: FramePrefix = ""
    """Put before the vehicle's frame names: `name/` where several vehicles share one tf tree."""

    tf: TfTree = TfTree()
    sensors: tuple[Sensor, ...] = ()
    streams: tuple[Stream, ...] = ()
    ground_truth: GroundTruth = GroundTruth()
    from_ros: FromRos = FromRos()
    route: Route | None = None
    """Where a driver of its own drives it; none: it waits for commands."""


FIXED_EPOCH_NANOS = 1_000_000_000 * NANOS
"""2001-09-09 01:46:40 UTC, where runs begin that do not follow the wall clock. Sim time can be read
from the digits of a stamp. tf takes a stamp of 0 for "the newest", so it is no good beginning; a
date long past is not mistaken for that of the recording."""


class Time(Spec, frozen=True):
    """How sim time runs, who is waited for, and what stamps mean."""

    mode: Literal["realtime", "fast", "lockstep"] = "realtime"
    """`realtime` keeps to the wall clock; `lockstep` never steps before all who take part have
    followed, and keeps to the wall clock as well as that allows; `fast` is lockstep without one."""

    lockstep: Literal["sensors", "ros"] = "sensors"
    """Who takes part in lockstep and fast mode, besides drivers: the sensors, or ROS as well."""

    factor: Annotated[float, Meta(gt=0)] = 1.0
    """Sim seconds for each second of the wall's, in realtime and lockstep mode."""

    overload: Literal["slow", "skip", "fail"] = "slow"
    """What gives way when a process cannot keep up: time, which stretches; the readings, which are
    left out and marked; or the run, which ends."""

    deadline_s: Annotated[float, Meta(gt=0)] = 5.0
    """For so long on the wall clock a process may hold up the run before it is named, and before
    `overload` acts."""

    catch_up: Annotated[float, Meta(ge=0, le=0.05)] = 0.05
    """In realtime mode: how much faster than `factor` time goes after a hold-up, as a fraction,
    until stamps are back at the wall clock; with 0 they stay behind."""

    epoch: Literal["wall", "fixed", "zero"] | None = None
    """Stamp of sim time zero: the wall clock's at the start, 1,000,000,000 s, or zero. Default:
    `wall` in realtime mode, otherwise `fixed`."""

    clock_rate_hz: Annotated[float, Meta(gt=0, le=400)] = 100.0
    window_ticks: Annotated[int, Meta(ge=8)] = 400
    """Physics is at most this far ahead of the slowest process that it waits for; a period of the
    clock or more, since gateway and recorder tell their progress with each message of the clock."""

    answers: dict[RosTopic, RosTopic] = field(default_factory=lambda: {"/cmd_vel": "/clock"})
    """With `lockstep: ros`: on which topic ROS publishes one message for each message of which
    other topic. Time goes on when it has."""

    def __post_init__(self) -> None:
        if isinf(self.factor):
            raise ValueError("`factor` is infinite; `mode: fast` has no wall clock to keep to")
        if not isfinite(self.deadline_s):
            raise ValueError(
                f"`deadline_s` is {self.deadline_s}; expected seconds, such as 5.0; with "
                "`overload: slow` a run in lockstep is waited for however long it takes"
            )
        if self.lockstep == "ros":
            if self.mode == "realtime":
                raise ValueError(
                    "`lockstep: ros` waits for ROS, and `mode: realtime` never does; choose "
                    "`mode: lockstep` or `fast`, or leave `lockstep` out"
                )
            if (TICK_RATE_HZ / exact(self.clock_rate_hz)).denominator > 1:
                raise ValueError(
                    "`lockstep: ros` steps from one message of the clock to the next, which takes "
                    f"a `clock_rate_hz` that divides {TICK_RATE_HZ}, such as 50, 100 or 200"
                )

    @property
    def epoch_nanos(self) -> int | None:
        """Return the stamp of sim time zero; None for the wall clock's at the start."""
        match self.epoch or ("wall" if self.mode == "realtime" else "fixed"):
            case "wall":
                return None
            case "fixed":
                return FIXED_EPOCH_NANOS
            case _:
                return 0

    @property
    def waits(self) -> bool:
        """Whether sensors that are behind are waited for, so that none leaves readings out."""
        return self.mode != "realtime" or self.overload != "skip"

    @property
    def ack_ticks(self) -> int:
        """How often sensors tell their progress: ROS hears of an instant when all are beyond it."""
        if self.lockstep == "ros":
            return int(TICK_RATE_HZ / exact(self.clock_rate_hz))
        return self.window_ticks // ACKS_PER_WINDOW


class Scenario(Spec, frozen=True, kw_only=True):
    """A run: a seed, a world, vehicles with their sensors, and how it meets ROS."""

    name: Name
    description: str = ""
    seed: Annotated[int, Meta(ge=0)] = 0
    time: Time = Time()
    world: World
    vehicles: tuple[Vehicle, ...]
    bodies: BodyPoses = BodyPoses()
    gateway: GatewaySettings = GatewaySettings()

    def sensor(self, name: str) -> tuple[Vehicle, SensorSpec] | None:
        """Return the vehicle and the sensor called `vehicle/sensor`, or None."""
        for vehicle in self.vehicles:
            for sensor in vehicle.sensors:
                if f"{vehicle.name}/{sensor.name}" == name:
                    return vehicle, sensor
        return None

    def with_only(self, name: str) -> Scenario:
        """Return the scenario without all sensors but the one called `vehicle/sensor`."""
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
        """Return the ROS topic of the true positions of a vehicle's joints, other than wheels."""
        return vehicle.ground_truth.joints_topic or f"{vehicle.namespace}/ground_truth/joints"

    def true_topics(self, vehicle: Vehicle) -> list[str]:
        """Return the ROS topics of a vehicle's ground truth."""
        joints = [self.true_joints_topic(vehicle)] if vehicle.model.joints else []
        return [self.ground_truth_topic(vehicle), self.true_wheels_topic(vehicle), *joints]

    def vitals_topic(self, vehicle: Vehicle) -> str:
        """Return the topic of a vehicle's vitals in a recording."""
        return f"{vehicle.namespace}/vitals"

    def sensor_names(self) -> list[str]:
        """Return every sensor as `vehicle/sensor`, in the scenario's order."""
        return [f"{v.name}/{s.name}" for v in self.vehicles for s in v.sensors]


__all__ = ["Placement", "Scenario", "Time", "Vector3", "Vehicle", "World"]


class Addition(Spec, frozen=True):
    """What is added to a scenario."""

    solids: tuple[Solid, ...] = ()
    actors: tuple[Actor, ...] = ()
    vehicles: tuple[Vehicle, ...] = ()
    materials: dict[str, Material] = field(default_factory=dict)
    """What it is made of; where the world has one of that name, the world's counts."""

    def names(self) -> list[str]:
        """Return what its things are called."""
        vehicles, actors = (v.name for v in self.vehicles), (a.name for a in self.actors)
        return [*vehicles, *actors, *(solid.name for solid in self.solids)]
