# SPDX-License-Identifier: Apache-2.0
"""Which streams of the bus go to ROS: their keys, their wire types, their topics, their rates.

Rule: derived from the scenario and the two tables of types alone. This is where the vocabulary of
the bus meets the vocabulary of the wire.
"""

from __future__ import annotations

from dataclasses import dataclass

from groundlink.frames import quaternion_from_rpy
from groundlink.messages import Clock, Message
from groundlink.ros_messages import ROS_FORMS, StaticTransform
from groundlink.scenario import Scenario
from groundlink.topics import CLOCK, COMMAND, SENSOR_TOPICS, sensor_rate_hz
from udp_bridge.types import MSG_TYPES, type_number

CLOCK_TOPIC = "/clock"
TF_STATIC_TOPIC = "/tf_static"

TF_MESSAGE = type_number("TFMessage")
TWIST = type_number("Twist")

_MSG_TYPE_OF = {row.ros_type: number for number, row in MSG_TYPES.items() if row.ros_type}


@dataclass(frozen=True, kw_only=True)
class Stream:
    """A stream of the bus on its way to ROS."""

    key: str
    message: type[Message]
    topic: str
    declared_hz: float
    push: bool

    @property
    def msg_type(self) -> int:
        """The wire's number of the ROS type that the message becomes."""
        return _MSG_TYPE_OF[ROS_FORMS[self.message].ros_type]


def outgoing(scenario: Scenario, run: str) -> list[Stream]:
    """Return every stream that can go to ROS: the clock first, then the sensors in order."""
    streams = [
        Stream(
            key=CLOCK.key_in(run),
            message=Clock,
            topic=CLOCK_TOPIC,
            declared_hz=scenario.time.clock_rate_hz,
            push=True,
        )
    ]
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            topic = SENSOR_TOPICS[type(sensor)]
            stream = Stream(
                key=topic.key_in(run, vehicle=vehicle.name, sensor=sensor.name),
                message=topic.message,
                topic=sensor.topic,
                declared_hz=sensor_rate_hz(sensor),
                push=sensor.push,
            )
            streams.append(stream)
    return streams


def command_keys(scenario: Scenario, run: str) -> dict[str, str]:
    """Return, by ROS topic of a Twist, the key of the vehicle that obeys it."""
    return {
        vehicle.command_topic: COMMAND.key_in(run, vehicle=vehicle.name)
        for vehicle in scenario.vehicles
    }


def static_transforms(scenario: Scenario) -> list[StaticTransform]:
    """Return base_from_sensor of every sensor that has a frame of its own."""
    transforms = {}
    for vehicle in scenario.vehicles:
        base = vehicle.model.base_frame
        for sensor in vehicle.sensors:
            if sensor.frame != base:
                roll, pitch, yaw = sensor.mount.rpy_radians()
                child = vehicle.frame_prefix + sensor.frame
                transforms[child] = StaticTransform(
                    parent=vehicle.frame_prefix + base,
                    child=child,
                    translation_m=sensor.mount.xyz_m,
                    rotation=quaternion_from_rpy(roll, pitch, yaw),
                )
    return list(transforms.values())
