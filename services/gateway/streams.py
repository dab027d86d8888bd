# SPDX-License-Identifier: Apache-2.0
"""Which streams of the bus go to ROS: their keys, their wire types, their topics, their rates.

Rule: derived from the scenario and the two tables of types alone. This is where the vocabulary of
the bus meets the vocabulary of the wire; the way back is `incoming`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from groundlink.frames import quaternion_from_rpy
from groundlink.message_sizes import body_bytes
from groundlink.messages import Clock, Message
from groundlink.navigation import Transform, Transforms
from groundlink.ros_messages import ROS_FORMS
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensors import Lidar, Repair, RepairBy
from groundlink.topics import CLOCK, GROUND_TRUTH, SENSOR_TOPICS, STREAM_TOPICS, sensor_rate_hz
from udp_bridge.repair import Mode, parse_mode
from udp_bridge.types import MSG_TYPES, type_number

CLOCK_TOPIC = "/clock"
TF_STATIC_TOPIC = "/tf_static"

TF_MESSAGE = type_number("TFMessage")

_MSG_TYPE_OF = {row.ros_type: number for number, row in MSG_TYPES.items() if row.ros_type}


@dataclass(frozen=True, kw_only=True)
class Stream:
    """A stream of the bus on its way to ROS."""

    key: str
    message: type[Message]
    topic: str
    declared_hz: float
    push: bool
    repair: Repair = "none"
    waiting_bytes: int = 0
    """Of blocks of a whole, which do not supersede each other, those that may wait for the wire."""

    @property
    def msg_type(self) -> int:
        """The wire's number of the ROS type that the message becomes."""
        return _MSG_TYPE_OF[ROS_FORMS[self.message].ros_type]


def outgoing(scenario: Scenario, run: str) -> list[Stream]:
    """Return every stream that can go to ROS: the clock first, then each vehicle's in order."""
    clock = Stream(
        key=CLOCK.key_in(run),
        message=Clock,
        topic=CLOCK_TOPIC,
        declared_hz=scenario.time.clock_rate_hz,
        push=True,
    )
    return [clock, *(s for v in scenario.vehicles for s in _of_vehicle(scenario, v, run))]


def _of_vehicle(scenario: Scenario, vehicle: Vehicle, run: str) -> Iterator[Stream]:
    rows = [(SENSOR_TOPICS[type(s)], s, sensor_rate_hz(s)) for s in vehicle.sensors]
    extra = [(STREAM_TOPICS[s.kind], s, s.rate_hz) for s in vehicle.streams]
    for topic, spec, rate_hz in (*rows, *extra):
        yield Stream(
            key=topic.key_in(run, vehicle=vehicle.name, sensor=spec.name),
            message=topic.message,
            topic=spec.topic,
            declared_hz=rate_hz,
            push=spec.push,
            repair=spec.repair,
            waiting_bytes=_revolution_bytes(vehicle, spec),
        )
    yield Stream(
        key=GROUND_TRUTH.key_in(run, vehicle=vehicle.name),
        message=GROUND_TRUTH.message,
        topic=scenario.ground_truth_topic(vehicle),
        declared_hz=vehicle.ground_truth.rate_hz,
        push=vehicle.ground_truth.push,
    )


def _revolution_bytes(vehicle: Vehicle, spec: object) -> int:
    """Return the bytes of all blocks of a revolution, of a LiDAR that sends some."""
    if not isinstance(spec, Lidar) or spec.blocks_per_revolution == 1:
        return 0
    return spec.blocks_per_revolution * body_bytes(vehicle, spec)


def waiting_table(streams: Iterable[Stream]) -> dict[tuple[int, str], int]:
    """Return the bytes of each stream in blocks that may wait, by wire type and topic.

    A block may be held up as long as a whole revolution would be: no data get older by it.
    """
    return {(s.msg_type, s.topic): s.waiting_bytes for s in streams if s.waiting_bytes}


def repair_table(streams: Iterable[Stream]) -> dict[tuple[int, str], Mode]:
    """Return how what is lost of each stream is made good, by wire type and topic."""
    table = {}
    for stream in streams:
        said = stream.repair
        if isinstance(said, RepairBy):
            share = {"fec": said.fec} if said.fec is not None else {"resend": said.resend}
            mode = parse_mode(share)
        else:
            mode = parse_mode(said)
        if mode is not None:
            table[stream.msg_type, stream.topic] = mode
    return table


def static_transforms(scenario: Scenario, stamp_nanos: int) -> Transforms | None:
    """Return base_from_sensor of every sensor that has a frame of its own; None without any."""
    transforms = {}
    for vehicle in scenario.vehicles:
        base = vehicle.model.base_frame
        for sensor in vehicle.sensors:
            if sensor.frame != base:
                roll, pitch, yaw = sensor.mount.rpy_radians()
                child = vehicle.frame_prefix + sensor.frame
                transforms[child] = Transform(
                    stamp_nanos=stamp_nanos,
                    parent=vehicle.frame_prefix + base,
                    child=child,
                    translation_m=sensor.mount.xyz_m,
                    rotation=quaternion_from_rpy(roll, pitch, yaw),
                )
    return Transforms(tuple(transforms.values())) if transforms else None
