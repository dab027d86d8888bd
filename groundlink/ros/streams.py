# SPDX-License-Identifier: Apache-2.0
"""ROS topics of a run, each with its key on the bus, and static transforms.

Derived from the scenario and the table of topics alone. Gateway, recorder, viewer, replay and
physics use this module. Physics must not load ROS types, so nothing here imports
`groundlink.ros.cdr`, which converts the messages.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from msgspec.structs import replace

from groundlink.bus.core_topics import CLOCK, COMMAND, BusTopic
from groundlink.bus.topics import (
    BODIES,
    FAULTS,
    FROM_ROS,
    GROUND_TRUTH,
    JOINT_COMMAND,
    JOINT_GROUP_COMMAND,
    JOINTS,
    MISSING_READINGS,
    RELAYED,
    STREAM_TOPICS,
    TRUE_MAP,
    TRUE_WHEELS,
    VITALS,
    sensor_outputs,
)
from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import BusMessage, Clock, State, floats
from groundlink.messages.ground_truth import VITALS_HZ, WORLD_FRAME
from groundlink.messages.navigation import Transform, Transforms
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import Repair, SensorSpec
from groundlink.scenario.joints import JointInterface
from groundlink.scenario.ros_side import Stream
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.scenario.schema import Vehicle

from .node_graph import graph_mistake

CLOCK_TOPIC = "/clock"
TF_TOPIC = "/tf"
TF_STATIC_TOPIC = "/tf_static"
TRUE_TF_TOPIC = "/ground_truth/tf"
TRUE_MAP_TOPIC = "/ground_truth/map"


@dataclass(frozen=True, kw_only=True)
class RosStream:
    """A stream of the bus that is a ROS topic."""

    key: str
    message: type[BusMessage]
    topic: str
    declared_hz: float | None
    """Declared rate; None if the rate is not known."""

    ros_type: str = ""
    """ROS type, if it is not that of the message's codec."""

    joints: tuple[JointInterface, ...] = ()
    """Of a command of joints: all joints of the vehicle, or of the group whose values it has."""

    is_command: bool = False
    """Whether messages are commands to the run. Commands act at their stamps, which are of the
    run's time."""


@dataclass(frozen=True, kw_only=True)
class Outgoing(RosStream):
    """A stream from the bus to ROS."""

    declared_hz: float
    push: bool
    """Whether the gateway sends the stream to its peer without a subscription."""

    bulky: bool = False
    """See `BusTopic.bulky`."""

    repair: Repair = "none"
    in_blocks: tuple[Vehicle, RotatingLidar] | None = None
    """Vehicle and LiDAR, if the stream is a LiDAR's with revolutions in blocks."""


def outgoing(scenario: Scenario, run: str) -> list[Outgoing]:
    """Return the streams that can go to ROS: clock, streams of each vehicle, bodies, true map."""
    clock = Outgoing(
        key=CLOCK.key_in(run),
        message=Clock,
        topic=CLOCK_TOPIC,
        declared_hz=scenario.time.clock_rate_hz,
        push=True,
    )
    bodies = Outgoing(
        key=BODIES.key_in(run),
        message=BODIES.message,
        topic=scenario.bodies.topic,
        declared_hz=scenario.bodies.rate_hz,
        push=scenario.bodies.push,
    )
    of_vehicles = (s for v in scenario.vehicles for s in _of_vehicle(scenario, v, run))
    return [clock, *of_vehicles, bodies, *_true_map(scenario, run)]


WAITING_MESSAGES = 8192
"""Messages of the bus that may wait at a process that takes all streams; of many vehicles, more."""

WAITING_SECONDS = 4.0


def waiting_messages(scenario: Scenario, run: str) -> int:
    """Return how many messages of all streams may wait for a process that takes them.

    Enough for `WAITING_SECONDS`, and for all that physics and then the sensors can be ahead of a
    process that physics waits for.
    """
    seconds = max(WAITING_SECONDS, 2 * scenario.time.window_ticks * TICK_SECONDS)
    rates = (stream.declared_hz or 0.0 for stream in outgoing(scenario, run))
    return max(WAITING_MESSAGES, math.ceil(seconds * sum(rates)))


def _true_map(scenario: Scenario, run: str) -> Iterator[Outgoing]:
    if scenario.true_map is not None:
        yield Outgoing(
            key=TRUE_MAP.key_in(run),
            message=TRUE_MAP.message,
            topic=TRUE_MAP_TOPIC,
            declared_hz=scenario.true_map.rate_hz,
            push=True,
        )


def recorded_only(scenario: Scenario, run: str) -> list[RosStream]:
    """Return the streams that only recordings have: vitals, and faults and gaps of sensors."""
    vitals = [
        RosStream(
            key=VITALS.key_in(run, vehicle=vehicle.name),
            message=VITALS.message,
            topic=scenario.vitals_topic(vehicle),
            declared_hz=float(VITALS_HZ),
        )
        for vehicle in scenario.vehicles
    ]
    per_sensor = [
        RosStream(
            key=row.key_in(run, process=sensor),
            message=row.message,
            topic=topic(sensor),
            declared_hz=None,
        )
        for row, topic in ((FAULTS, faults_topic), (MISSING_READINGS, missing_readings_topic))
        for sensor in scenario.sensor_names()
    ]
    return [*vitals, *per_sensor]


def faults_topic(sensor: str) -> str:
    """Return the topic of a sensor's faults in a recording."""
    return f"/faults/{sensor}"


def missing_readings_topic(sensor: str) -> str:
    """Return the topic of a sensor's missing readings in a recording."""
    return f"/gaps/{sensor}"


def incoming(scenario: Scenario, run: str) -> list[RosStream]:
    """Return the streams from ROS: commands of each vehicle, then topics of its stack."""
    streams = []
    for vehicle in scenario.vehicles:
        stamped = "geometry_msgs/msg/TwistStamped" if vehicle.command_type != "Twist" else ""
        rows = [(COMMAND, vehicle.command_topic, stamped)]
        rows += [(row, getattr(vehicle.from_ros, name), "") for name, row in FROM_ROS.items()]
        streams += [
            RosStream(
                key=row.key_in(run, vehicle=vehicle.name),
                message=row.message,
                topic=topic,
                declared_hz=None,
                ros_type=ros_type,
                joints=vehicle.model.joint_interfaces() if row is JOINT_COMMAND else (),
                is_command=row in (COMMAND, JOINT_COMMAND),
            )
            for row, topic, ros_type in rows
            if topic is not None
        ]
        streams += [
            RosStream(
                key=JOINT_GROUP_COMMAND.key_in(run, vehicle=vehicle.name, topic=topic.strip("/")),
                message=JOINT_GROUP_COMMAND.message,
                topic=topic,
                declared_hz=None,
                ros_type="std_msgs/msg/Float64MultiArray",
                joints=tuple(JointInterface(name, (group.interface,)) for name in group.joints),
                is_command=True,
            )
            for topic, group in vehicle.from_ros.joint_groups.items()
        ]
        streams += [
            RosStream(
                key=RELAYED.key_in(run, vehicle=vehicle.name, topic=topic.strip("/")),
                message=RELAYED.message,
                topic=topic,
                declared_hz=None,
                ros_type=ros_type.replace("/", "/msg/"),
            )
            for topic, ros_type in vehicle.from_ros.topics.items()
        ]
    return streams


def answers_mistake(scenario: Scenario) -> str:
    """Return the mistake in `answers` or `nodes`, such as an unknown topic; empty for none."""
    known = {stream.topic for stream in outgoing(scenario, "") if stream.push}
    if scenario.time.nodes:
        mistake = graph_mistake(scenario.time.nodes, known)
        return f"`time.nodes`: {mistake}" if mistake else ""
    for topic, of in scenario.time.answers.items():
        if of not in known:
            return (
                f"`time.answers`: {topic} cannot answer {of}, which does not go to ROS unasked; "
                f"expected one of {', '.join(sorted(known))}"
            )
    return ""


def _of_vehicle(scenario: Scenario, vehicle: Vehicle, run: str) -> Iterator[Outgoing]:
    rows: list[tuple[BusTopic, str, SensorSpec | Stream, float]] = [
        (output.row, output.ros_topic, s, s.message_rate_hz)
        for s in vehicle.sensors
        for output in sensor_outputs(s)
    ]
    rows += [(STREAM_TOPICS[s.kind], s.topic, s, s.rate_hz) for s in vehicle.streams]
    for row, topic, spec, rate_hz in rows:
        yield Outgoing(
            key=row.key_in(run, vehicle=vehicle.name, sensor=spec.name),
            message=row.message,
            topic=topic,
            declared_hz=rate_hz,
            push=spec.push,
            bulky=row.bulky,
            repair=spec.repair,
            in_blocks=_in_blocks(vehicle, spec),
        )
    # Without joints, a vehicle has no topic for them.
    truths = zip((GROUND_TRUTH, TRUE_WHEELS, JOINTS), scenario.true_topics(vehicle), strict=False)
    for row, place in truths:
        yield Outgoing(
            key=row.key_in(run, vehicle=vehicle.name),
            message=row.message,
            topic=place,
            declared_hz=vehicle.ground_truth.rate_hz,
            push=vehicle.ground_truth.push,
        )


def _in_blocks(vehicle: Vehicle, spec: object) -> tuple[Vehicle, RotatingLidar] | None:
    if not isinstance(spec, RotatingLidar) or spec.blocks_per_revolution == 1:
        return None
    return vehicle, spec


def static_transforms(scenario: Scenario, stamp_nanos: int) -> Transforms | None:
    """Return link_from_sensor of all sensors with a mount; None if there are none."""
    transforms = tuple(
        replace(
            mount,
            parent=vehicle.frame_prefix + mount.parent,
            child=vehicle.frame_prefix + mount.child,
        )
        for vehicle in scenario.vehicles
        for mount in mounts(vehicle, stamp_nanos)
    )
    return Transforms(transforms) if transforms else None


def mounts(vehicle: Vehicle, stamp_nanos: int) -> tuple[Transform, ...]:
    """Return link_from_sensor of each sensor frame of a vehicle, without the frame prefix.

    If several sensors share a frame, the mount of the last one is used.
    """
    links = vehicle.model.link_names()
    found = {
        sensor.frame: Transform(
            stamp_nanos=stamp_nanos,
            parent=links[vehicle.model.link_of(sensor.mount)],
            child=sensor.frame,
            translation_m=sensor.mount.xyz_m,
            rotation=sensor.mount.quaternion(optical=sensor.optical),
        )
        for sensor in vehicle.sensors
        if sensor.mounted and sensor.frame != links[0]
    }
    return tuple(found.values())


def actor_transforms(scenario: Scenario, state: State) -> Transforms:
    """Return world_from_actor of every actor, for the tf tree of a viewer."""
    poses = floats(state.actors).reshape(-1, 7).tolist()
    return Transforms(
        tuple(
            Transform(
                stamp_nanos=state.stamp_nanos,
                parent=WORLD_FRAME,
                child=actor.name,
                translation_m=(x, y, z),
                rotation=(qx, qy, qz, qw),
            )
            for actor, (x, y, z, qx, qy, qz, qw) in zip(scenario.world.actors, poses, strict=False)
        )
    )
