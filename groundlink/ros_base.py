# SPDX-License-Identifier: Apache-2.0
"""What the driver of a real base tells ROS beside its sensors: joint states, tf, its description.

Rule: made of what the vehicle's sensors say, with their stamps and errors, and of the scenario;
never of the truth, but for `map: truth`, which is asked for. Messages of the bus go in, messages of
ROS's words come out; nothing of this is on the bus. Of several encoders or odometries of a vehicle
the first counts, for a frame has one parent and a joint one angle.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple, TypeVar

import numpy as np

from .clock import NANOS
from .frames import (
    IDENTITY_QUATERNION,
    Floats,
    conjugate,
    matrix_from_quaternion,
    multiply,
    nlerp,
)
from .ground_truth import WORLD_FRAME
from .messages import Message, WheelEncoders, measured_nanos, packed
from .navigation import JointState, Odometry, Transform, Transforms
from .robot_description import urdf
from .ros_streams import TF_TOPIC, mounts, static_transforms
from .scenario.schema import Scenario, Vehicle
from .scenario.sensors import Encoders, WheelOdometry
from .topics import ENCODERS, GROUND_TRUTH, WHEEL_ODOMETRY

S = TypeVar("S")

MAP_FRAME, ODOM_FRAME = "map", "odom"
"""REP 105's."""

WAITING = 64
"""Odometry that may wait for the truth of its instant, which physics tells at its own rate."""

POSSIBLE = 2.0
"""Times what a wheel can turn at most; a faster step is a counter that was reset."""


class Told(NamedTuple):
    """Something for ROS."""

    topic: str
    message: Message


class Place(NamedTuple):
    """A topic that something is told on."""

    topic: str
    message: type[Message]
    declared_hz: float


class Base:
    """The base of one vehicle."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, run: str) -> None:
        self._vehicle = vehicle
        self._encoders = _first(vehicle, Encoders)
        odometry = _first(vehicle, WheelOdometry) if vehicle.tf.odom else None
        self._joints_topic = f"{vehicle.namespace}/joint_states"
        self.places: list[Place] = []
        """What is told when messages of the bus come; the description is not among them."""

        self.keys: dict[str, str] = {}
        """Of the bus's messages that are listened to, by what they are to this."""

        if self._encoders is not None:
            key = ENCODERS.key_in(run, vehicle=vehicle.name, sensor=self._encoders.name)
            self.keys["encoders"] = key
            self.places.append(Place(self._joints_topic, JointState, self._encoders.rate_hz))
        tf_hz = 0.0
        if odometry is not None:
            key = WHEEL_ODOMETRY.key_in(run, vehicle=vehicle.name, sensor=odometry.name)
            self.keys["odometry"] = key
            tf_hz += odometry.rate_hz
        self._from_truth = _MapFromTruth(vehicle, alone=odometry is None)
        if vehicle.tf.map == "truth":
            self.keys["truth"] = GROUND_TRUTH.key_in(run, vehicle=vehicle.name)
            tf_hz += odometry.rate_hz if odometry else vehicle.ground_truth.rate_hz
        if tf_hz:
            self.places.append(Place(TF_TOPIC, Transforms, tf_hz))
        self._roles = {key: role for role, key in self.keys.items()}
        self.description_topic = f"{vehicle.namespace}/robot_description"
        self.description = urdf(
            vehicle.model, mounts(vehicle, 0), self._turning(), scenario.world.materials
        )
        """The vehicle's URDF."""

        self.restart()

    def restart(self) -> None:
        """Forget what was heard: a life of the run has begun."""
        self._last: tuple[int, Floats] | None = None
        self._from_truth.restart()

    def hear(self, key: str, message: Message) -> Iterator[Told]:
        """Yield what follows from a message of the bus."""
        role = self._roles.get(key)
        if role == "encoders" and isinstance(message, WheelEncoders):
            if len(message.ticks) != len(self._vehicle.model.counted):
                return  # of a replayed run, or a stranger's
            yield Told(self._joints_topic, self._joint_state(message))
        elif role is not None and isinstance(message, Odometry):
            if role == "odometry":
                moved = _transform(
                    *(message.stamp_nanos, message.frame, message.child_frame),
                    *(message.position_m, message.orientation),
                )
                yield Told(TF_TOPIC, Transforms((moved,)))
            if "truth" in self.keys:
                for transform in self._from_truth.hear(role, message):
                    yield Told(TF_TOPIC, Transforms((transform,)))

    def fixed(self, stamp_nanos: int) -> tuple[Transform, ...]:
        """Return the transforms above `odom` that never change."""
        prefix = self._vehicle.frame_prefix
        odometry = _first(self._vehicle, WheelOdometry)
        if self._vehicle.tf.map == "truth":
            still = (stamp_nanos, WORLD_FRAME, MAP_FRAME)
        elif self._vehicle.tf.map == "identity":
            # Who has no wheel odometry may have another, such as that of a LiDAR.
            frame = odometry.frame if odometry else ODOM_FRAME
            still = (stamp_nanos, prefix + MAP_FRAME, prefix + frame)
        else:
            return ()
        return (_transform(*still, (0.0, 0.0, 0.0), IDENTITY_QUATERNION),)

    def _turning(self) -> list[str]:
        """Return the wheels whose angles the encoders tell."""
        model = self._vehicle.model
        counted = model.counted if self._encoders is not None else ()
        return [model.wheels[i].name for shaft in counted for i in shaft.wheels]

    def _joint_state(self, message: WheelEncoders) -> JointState:
        """Return the angle and speed of each wheel on a shaft that is counted."""
        spec, model = self._encoders, self._vehicle.model
        assert spec is not None
        radians_per_tick = 2 * math.pi / spec.ticks_per_wheel_revolution
        angles = []
        for shaft, ticks in zip(model.counted, message.ticks, strict=True):
            sign = -1 if shaft.name in spec.reversed_wheels else 1
            since = (ticks - spec.start_ticks + 2**63) % 2**64 - 2**63
            for i in shaft.wheels:
                # Wheels of a track roll equally fast, whatever their radii.
                gear = shaft.radius_m / model.wheels[i].radius_m
                angles.append(sign * since * radians_per_tick * gear)
        now, speeds = np.array(angles), np.zeros(len(angles))
        if self._last is not None and message.stamp_nanos > self._last[0]:
            speeds = (now - self._last[1]) / ((message.stamp_nanos - self._last[0]) / NANOS)
            if np.abs(speeds).max() > POSSIBLE * self._fastest_radps():
                speeds[:] = 0.0
        self._last = message.stamp_nanos, now
        return JointState(
            stamp_nanos=message.stamp_nanos,
            frame="",
            names=tuple(self._turning()),
            positions=packed(now),
            velocities=packed(speeds),
            efforts=memoryview(b""),
        )

    def _fastest_radps(self) -> float:
        model = self._vehicle.model
        return model.drive.max_wheel_speed_radps * max(
            shaft.radius_m / model.wheels[i].radius_m
            for shaft in model.counted
            for i in shaft.wheels
        )


class _MapFromTruth:
    """Where `odom` is in the map, if the map is the world: what an ideal localisation says.

    A vehicle without odometry has no `odom`: its base is told instead.
    """

    def __init__(self, vehicle: Vehicle, *, alone: bool) -> None:
        self._alone = alone
        self._odometry: deque[Odometry] = deque(maxlen=WAITING)
        self._truths: deque[Odometry] = deque(maxlen=WAITING)

    def restart(self) -> None:
        """Forget all."""
        self._odometry.clear()
        self._truths.clear()

    def hear(self, role: str, message: Odometry) -> Iterator[Transform]:
        """Yield a transform of each odometry's instant, as soon as the truth of it is known."""
        if role == "truth" and self._alone:
            yield _transform(
                *(message.stamp_nanos, MAP_FRAME, message.child_frame),
                *(message.position_m, message.orientation),
            )
            return
        (self._truths if role == "truth" else self._odometry).append(message)
        while self._odometry and self._truths:
            odometry = self._odometry[0]
            if self._truths[-1].stamp_nanos < measured_nanos(odometry):
                return
            self._odometry.popleft()
            if self._truths[0].stamp_nanos <= measured_nanos(odometry):
                yield self._between(odometry)

    def _between(self, odometry: Odometry) -> Transform:
        """Return map_from_odom = map_from_base @ base_from_odom at an odometry's instant."""
        at = measured_nanos(odometry)
        before = [truth for truth in self._truths if truth.stamp_nanos <= at][-1]
        after = next(truth for truth in self._truths if truth.stamp_nanos >= at)
        span = after.stamp_nanos - before.stamp_nanos
        fraction = np.float64((at - before.stamp_nanos) / span if span else 0.0)
        first, second = np.array(before.position_m), np.array(after.position_m)
        position = first + fraction * (second - first)
        turned = nlerp(
            np.array(before.orientation), np.array(after.orientation), np.array(fraction)
        )
        rotation = multiply(turned, conjugate(odometry.orientation))
        moved = position - matrix_from_quaternion(rotation) @ np.array(odometry.position_m)
        x, y, z = moved.tolist()
        qx, qy, qz, qw = rotation.tolist()
        return _transform(
            *(odometry.stamp_nanos, MAP_FRAME, odometry.frame, (x, y, z), (qx, qy, qz, qw))
        )


def still_transforms(scenario: Scenario, bases: list[Base], stamp_nanos: int) -> Transforms | None:
    """Return what never changes of the tf tree: mounts of sensors, and where maps are."""
    of_sensors = static_transforms(scenario, stamp_nanos)
    rows = list(of_sensors.transforms) if of_sensors else []
    rows += dict.fromkeys(row for base in bases for row in base.fixed(stamp_nanos))
    return Transforms(tuple(rows)) if rows else None


def _transform(
    stamp_nanos: int,
    parent: str,
    child: str,
    translation_m: tuple[float, float, float],
    rotation: tuple[float, float, float, float],
) -> Transform:
    return Transform(
        stamp_nanos=stamp_nanos,
        parent=parent,
        child=child,
        translation_m=translation_m,
        rotation=rotation,
    )


def _first(vehicle: Vehicle, kind: type[S]) -> S | None:
    return next((sensor for sensor in vehicle.sensors if isinstance(sensor, kind)), None)
