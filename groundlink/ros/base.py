# SPDX-License-Identifier: Apache-2.0
"""Base driver of a vehicle for ROS: joint states, tf and robot description.

Its messages are made from the vehicle's sensor readings, with their stamps and errors, and from the
scenario. Ground truth is used only for `map: truth`. Bus messages are the input and ROS messages
the output; the output is not on the bus. If a vehicle has several encoders or wheel odometries,
only the first is used, since a frame has one parent and a joint one angle.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.bus.topics import GROUND_TRUTH, JOINTS, SENSOR_TOPICS, TRUE_WHEELS
from groundlink.core.clock import NANOS
from groundlink.core.frames import IDENTITY_QUATERNION, Floats
from groundlink.messages.base import BusMessage, WheelEncoders, measured_nanos, packed
from groundlink.messages.ground_truth import WORLD_FRAME
from groundlink.messages.navigation import JointState, Odometry, Text, Transform, Transforms
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.wheel_encoders import IncrementalEncoders

from .all_joints import AllJoints
from .robot_description import Ros2Control, urdf
from .streams import (
    TF_STATIC_TOPIC,
    TF_TOPIC,
    TRUE_MAP_TOPIC,
    TRUE_TF_TOPIC,
    mounts,
    static_transforms,
)
from .tf_tree import TopFromTruth, stamped

MAP_FRAME, ODOM_FRAME = "map", "odom"
"""Frame names of REP 105."""

JOINT_STATES, DESCRIPTION = "joint_states", "robot_description"
"""Topic names in a vehicle's namespace."""

POSSIBLE = 2.0
"""Factor on the largest possible wheel speed. A faster change of a counter is a counter reset."""


class DerivedMessage(NamedTuple):
    """Message for ROS, with its topic and instant."""

    topic: str
    message: BusMessage
    nanos: int
    """Instant of the message on the run's time line."""


class BaseTopic(NamedTuple):
    """Topic of the base driver, with message type and rate."""

    topic: str
    message: type[BusMessage]
    declared_hz: float


class Base:
    """Base driver of one vehicle."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, run: str) -> None:
        self._vehicle = vehicle
        self._encoders = _encoders(vehicle)
        # Computed once: every message of the encoders needs them.
        self._counted = vehicle.model.counted if self._encoders is not None else ()
        wheels = vehicle.model.wheels
        self._turning = tuple(wheels[i].name for shaft in self._counted for i in shaft.wheels)
        """Names of the wheels whose angles the encoders measure."""

        self._most_radps = POSSIBLE * self._fastest_radps() if self._counted else 0.0
        odometry = _odometry(vehicle) if vehicle.tf.odom else None
        self._joints_topic = f"{vehicle.namespace}/{JOINT_STATES}"
        self.topics: list[BaseTopic] = []
        """Topics of the messages that follow from bus messages, without the robot description."""

        self.keys: dict[str, str] = {}
        """Keys of the bus topics that the driver subscribes to, by role."""

        self._all_joints: AllJoints | None = None
        if self._encoders is not None:
            self.keys["encoders"] = _key(run, vehicle, self._encoders)
            self.topics.append(BaseTopic(self._joints_topic, JointState, self._encoders.rate_hz))
        if vehicle.true_joints:
            self.keys["joints"] = JOINTS.key_in(run, vehicle=vehicle.name)
        if vehicle.takes_joint_commands:
            self.keys["wheels"] = TRUE_WHEELS.key_in(run, vehicle=vehicle.name)
            self._all_joints = AllJoints(vehicle, has_encoders=self._encoders is not None)
        has_own_messages = (
            vehicle.true_joints if self._all_joints is None else self._encoders is None
        )
        if has_own_messages:
            self.topics.append(
                BaseTopic(self._joints_topic, JointState, vehicle.ground_truth.rate_hz)
            )
        tf_hz = 0.0
        if odometry is not None:
            self.keys["odometry"] = _key(run, vehicle, odometry)
            tf_hz += odometry.message_rate_hz
        self._from_truth = TopFromTruth(
            MAP_FRAME, _top(vehicle, odometry), without_odometry=odometry is None
        )
        if vehicle.tf.map == "truth":
            self.keys["truth"] = GROUND_TRUTH.key_in(run, vehicle=vehicle.name)
            tf_hz += odometry.message_rate_hz if odometry else vehicle.ground_truth.rate_hz
        if tf_hz:
            self.topics.append(BaseTopic(TF_TOPIC, Transforms, tf_hz))
        self.roles = {key: role for role, key in self.keys.items()}
        """Roles of the bus topics, by key."""

        self.description_topic = f"{vehicle.namespace}/{DESCRIPTION}"
        self.description = urdf(
            vehicle.model,
            mounts(vehicle, 0),
            self._all_joints.names if self._all_joints else self._turning,
            scenario.world.materials,
            self._ros2_control(),
        )
        """Robot description of the vehicle as URDF."""

        self.restart()

    def restart(self) -> None:
        """Reset the state at the start of an episode."""
        self._last: tuple[int, Floats] | None = None
        self._from_truth.restart()
        if self._all_joints is not None:
            self._all_joints.restart()

    def receive(self, key: str, message: BusMessage) -> Iterator[DerivedMessage]:
        """Yield the ROS messages that follow from a message of the bus."""
        role = self.roles.get(key)
        if role == "encoders" and isinstance(message, WheelEncoders):
            if len(message.ticks) != len(self._counted):
                return  # The reading is from a replayed run or another publisher.
            measured = self._joint_state(message)
            yield from self._joint_states("encoders", measured, measured_nanos(message))
        elif role in ("wheels", "joints") and isinstance(message, JointState):
            truth = replace(message, frame="")
            yield from self._joint_states(role, truth, message.stamp_nanos)
        elif role is not None and isinstance(message, Odometry):
            if role == "odometry":
                moved = stamped(
                    *(message.stamp_nanos, message.frame, message.child_frame),
                    *(message.position_m, message.orientation),
                )
                yield DerivedMessage(TF_TOPIC, Transforms((moved,)), measured_nanos(message))
            if "truth" in self.keys:
                for nanos, transform in self._from_truth.receive(role, message):
                    yield DerivedMessage(TF_TOPIC, Transforms((transform,)), nanos)

    def _joint_states(self, role: str, message: JointState, nanos: int) -> Iterator[DerivedMessage]:
        """Yield the joint states that follow from a message of its instant."""
        if self._all_joints is None:
            yield DerivedMessage(self._joints_topic, message, nanos)
            return
        for at, joined in self._all_joints.receive(role, message, nanos):
            yield DerivedMessage(self._joints_topic, joined, at)

    def _ros2_control(self) -> Ros2Control | None:
        """Return the topics of `ros2_control` if ROS commands joints by JointState."""
        commands = self._vehicle.from_ros.joints
        return None if commands is None else Ros2Control(commands, self._joints_topic)

    def fixed(self, stamp_nanos: int) -> tuple[Transform, ...]:
        """Return the static transforms above `odom`."""
        prefix = self._vehicle.frame_prefix
        odometry = _odometry(self._vehicle)
        if self._vehicle.tf.map == "truth":
            still = (stamp_nanos, WORLD_FRAME, MAP_FRAME)
        elif self._vehicle.tf.map == "identity":
            # A vehicle without wheel odometry may have another odometry, such as that of a LiDAR.
            frame = odometry.frame if odometry else ODOM_FRAME
            still = (stamp_nanos, prefix + MAP_FRAME, prefix + frame)
        else:
            return ()
        return (stamped(*still, (0.0, 0.0, 0.0), IDENTITY_QUATERNION),)

    def _joint_state(self, message: WheelEncoders) -> JointState:
        """Return the angle and speed of each wheel on a shaft with an encoder."""
        spec, model = self._encoders, self._vehicle.model
        assert spec is not None
        radians_per_tick = 2 * math.pi / spec.ticks_per_wheel_revolution
        angles = []
        for shaft, ticks in zip(self._counted, message.ticks, strict=True):
            sign = -1 if shaft.name in spec.reversed_wheels else 1
            since = (ticks - spec.start_ticks + 2**63) % 2**64 - 2**63
            for i in shaft.wheels:
                # Wheels of a track roll at the same speed, whatever their radii.
                gear = shaft.radius_m / model.wheels[i].radius_m
                angles.append(sign * since * radians_per_tick * gear)
        now, speeds = np.array(angles), np.zeros(len(angles))
        if self._last is not None and message.stamp_nanos > self._last[0]:
            speeds = (now - self._last[1]) / ((message.stamp_nanos - self._last[0]) / NANOS)
            if np.abs(speeds).max() > self._most_radps:
                speeds[:] = 0.0
        self._last = message.stamp_nanos, now
        return JointState(
            stamp_nanos=message.stamp_nanos,
            frame="",
            names=self._turning,
            positions=packed(now),
            velocities=packed(speeds),
            efforts=memoryview(b""),
        )

    def _fastest_radps(self) -> float:
        model = self._vehicle.model
        return model.drive.max_wheel_speed_radps * max(
            shaft.radius_m / model.wheels[i].radius_m
            for shaft in self._counted
            for i in shaft.wheels
        )


class TrueTree:
    """True transform from `world` to the topmost frame of a vehicle's tree, on a separate topic.

    Only recordings and viewers have it. It extends the tree of `/tf` at the top, so that no frame
    gets a second parent; base_link keeps the parent that it has in ROS.
    """

    def __init__(self, vehicle: Vehicle, run: str) -> None:
        odometry = _odometry(vehicle) if vehicle.tf.odom else None
        self.roles: dict[str, str] = {}
        """Roles of the bus topics that the tree follows, by key."""

        self.topics: list[BaseTopic] = []
        """Topics of the messages; empty if `/tf` includes `world` already."""

        if vehicle.tf.map != "truth":
            self.roles[GROUND_TRUTH.key_in(run, vehicle=vehicle.name)] = "truth"
            rate_hz = vehicle.ground_truth.rate_hz
            if odometry is not None:
                self.roles[_key(run, vehicle, odometry)] = "odometry"
                rate_hz = odometry.message_rate_hz
            self.topics.append(BaseTopic(TRUE_TF_TOPIC, Transforms, rate_hz))
        self._from_truth = TopFromTruth(
            WORLD_FRAME, _top(vehicle, odometry), without_odometry=odometry is None
        )

    def restart(self) -> None:
        """Reset the state at the start of an episode."""
        self._from_truth.restart()

    def receive(self, key: str, message: BusMessage) -> Iterator[DerivedMessage]:
        """Yield the ROS messages that follow from a message of the bus."""
        role = self.roles.get(key)
        if role is not None and isinstance(message, Odometry):
            for nanos, transform in self._from_truth.receive(role, message):
                yield DerivedMessage(TRUE_TF_TOPIC, Transforms((transform,)), nanos)


class Bases:
    """Base drivers of all vehicles of a run.

    Parameters
    ----------
    truth
        whether to publish the true tree on `TRUE_TF_TOPIC` as well; gateways never do.
    """

    def __init__(self, scenario: Scenario, run: str, *, truth: bool = False) -> None:
        self._scenario = scenario
        self._bases = [Base(scenario, vehicle, run) for vehicle in scenario.vehicles]
        trees = [TrueTree(vehicle, run) for vehicle in scenario.vehicles if truth]
        self._drivers: list[Base | TrueTree] = [*self._bases, *trees]
        self._by_key: dict[str, list[Base | TrueTree]] = defaultdict(list)
        for driver in self._drivers:
            for key in driver.roles:
                self._by_key[key].append(driver)
        self.topics = [topic for driver in self._drivers for topic in driver.topics]
        """Topics of the messages that follow from bus messages."""

        self.latched: dict[str, type[BusMessage]] = {
            TF_STATIC_TOPIC: Transforms,
            **{base.description_topic: Text for base in self._bases},
        }
        """Message types of latched topics: all topics that `still` can publish."""

    def receive(self, key: str, message: BusMessage) -> Iterator[DerivedMessage]:
        """Yield the ROS messages that follow from a message of the bus."""
        for driver in self._by_key.get(key, ()):
            yield from driver.receive(key, message)

    def restart(self) -> None:
        """Reset the state at the start of an episode."""
        for driver in self._drivers:
            driver.restart()

    def still(self, stamp_nanos: int) -> Iterator[DerivedMessage]:
        """Yield the latched messages: static transforms and robot descriptions."""
        if transforms := still_transforms(self._scenario, self._bases, stamp_nanos):
            yield DerivedMessage(TF_STATIC_TOPIC, transforms, stamp_nanos)
        for base in self._bases:
            text = Text(stamp_nanos, base.description)
            yield DerivedMessage(base.description_topic, text, stamp_nanos)


def still_transforms(scenario: Scenario, bases: list[Base], stamp_nanos: int) -> Transforms | None:
    """Return the static transforms: sensor mounts, and the frames above `odom`."""
    of_sensors = static_transforms(scenario, stamp_nanos)
    rows = list(of_sensors.transforms) if of_sensors else []
    rows += dict.fromkeys(row for base in bases for row in base.fixed(stamp_nanos))
    return Transforms(tuple(rows)) if rows else None


def made_topics(scenario: Scenario) -> set[str]:
    """Return all topics that base drivers can publish, whether or not the scenario needs them."""
    of_vehicles = (
        f"{vehicle.namespace}/{name}"
        for vehicle in scenario.vehicles
        for name in (JOINT_STATES, DESCRIPTION)
    )
    return {TF_TOPIC, TF_STATIC_TOPIC, TRUE_TF_TOPIC, *of_vehicles}


def is_latched(topic: str) -> bool:
    """Return whether a topic is latched: published once, and kept for late subscribers."""
    return topic in (TF_STATIC_TOPIC, TRUE_MAP_TOPIC) or topic.endswith(
        (f"/{DESCRIPTION}", "/labels/label_info", "/labels/instance_info")
    )


def _top(vehicle: Vehicle, odometry: SensorSpec | None) -> str:
    """Return the topmost frame of a vehicle's tree, if no ground truth is used for its map."""
    if odometry is None:
        return vehicle.frame_prefix + vehicle.model.base_frame
    frame = MAP_FRAME if vehicle.tf.map == "identity" else odometry.frame
    return vehicle.frame_prefix + frame


def _encoders(vehicle: Vehicle) -> IncrementalEncoders | None:
    return next((s for s in vehicle.sensors if isinstance(s, IncrementalEncoders)), None)


def _odometry(vehicle: Vehicle) -> SensorSpec | None:
    """Return the first sensor that publishes odometry."""
    rows = ((sensor, SENSOR_TOPICS.get(sensor.kind)) for sensor in vehicle.sensors)
    return next((sensor for sensor, row in rows if row and row.message is Odometry), None)


def _key(run: str, vehicle: Vehicle, sensor: SensorSpec) -> str:
    """Return the key of a sensor's main stream."""
    return SENSOR_TOPICS[sensor.kind].key_in(run, vehicle=vehicle.name, sensor=sensor.name)
