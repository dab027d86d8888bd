# SPDX-License-Identifier: Apache-2.0
"""The ground truth as messages of ROS's words: what every estimate is compared with.

Rule: states in, messages out, at the rate that the scenario declares and stamped with their event
as a sensor's reading would be. Between two states nothing is interpolated: the values are those of
the first tick at or after the event. They have no error, so their covariances are zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from groundlink.clock import Schedule
from groundlink.frames import IDENTITY_QUATERNION, matrix_from_quaternion
from groundlink.ground_truth import WORLD_FRAME, Bodies
from groundlink.messages import State, floats
from groundlink.navigation import COVARIANCE_6X6_BYTES, JointState, Odometry
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.world.bodies import body_names
from groundlink.world.solids import Solid

_NO_ERROR = memoryview(bytes(COVARIANCE_6X6_BYTES))


class _Events:
    """When something is due, at a rate."""

    def __init__(self, rate_hz: float) -> None:
        self._schedule = Schedule.at(rate_hz)
        self._next = 0
        self._due_tick = self._schedule.tick(0)  # kept, since it is asked for at every tick

    def stamp(self, state: State) -> int | None:
        """Return the stamp of the next event if this state is the first at or after it."""
        if state.tick < self._due_tick:
            return None
        stamp = state.epoch_nanos + self._schedule.nanos(self._next)
        self._next += 1
        self._due_tick = self._schedule.tick(self._next)
        return stamp


class Truth:
    """The ground truth of one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle.name
        self._child_frame = vehicle.frame_prefix + vehicle.model.base_frame
        self._wheels = tuple(wheel.name for wheel in vehicle.model.wheels)
        self._events = _Events(vehicle.ground_truth.rate_hz)

    def due(self, state: State) -> int | None:
        """Return the stamp of what is to be told of this state; None for nothing."""
        return self._events.stamp(state)

    def odometry(self, state: State, stamp_nanos: int) -> Odometry:
        """Return world_from_base and the base's velocity in its own frame."""
        vehicle = state.vehicles[self.vehicle]
        x, y, z, qx, qy, qz, qw = vehicle.poses()[0].tolist()
        base_from_world = matrix_from_quaternion(np.array([qx, qy, qz, qw])).T
        velocities = floats(vehicle.base_velocity).reshape(2, 3) @ base_from_world.T
        linear, angular = velocities.tolist()
        return Odometry(
            stamp_nanos=stamp_nanos,
            frame=WORLD_FRAME,
            child_frame=self._child_frame,
            position_m=(x, y, z),
            orientation=(qx, qy, qz, qw),
            linear_mps=tuple(linear),
            angular_radps=tuple(angular),
            pose_covariance=_NO_ERROR,
            twist_covariance=_NO_ERROR,
        )

    def wheels(self, state: State, torques: memoryview, stamp_nanos: int) -> JointState:
        """Return each wheel's angle, speed and the torque of its motor, float64 in N m."""
        vehicle = state.vehicles[self.vehicle]
        return JointState(
            stamp_nanos=stamp_nanos,
            frame=self._child_frame,
            names=self._wheels,
            positions=vehicle.joint_positions,
            velocities=vehicle.joint_velocities,
            efforts=torques,
        )


class BodyTruth:
    """Where all bodies of the run are."""

    def __init__(self, scenario: Scenario, static: Sequence[Solid]) -> None:
        self._events = _Events(scenario.bodies.rate_hz)
        self.change(scenario, static)

    def change(self, scenario: Scenario, static: Sequence[Solid]) -> None:
        """Tell of the bodies of another world from now on."""
        self._vehicles = [vehicle.name for vehicle in scenario.vehicles]
        self._names = body_names(scenario, static)
        still = [(*solid.position_m, *solid.orientation) for solid in static]
        if scenario.world.terrain:
            still.append((*scenario.world.terrain.at_m, *IDENTITY_QUATERNION))
        self._still = np.array(still, np.float64).tobytes()

    def poses(self, state: State) -> Bodies | None:
        """Return world_from_body of every body, if it is due."""
        stamp = self._events.stamp(state)
        if stamp is None:
            return None
        moving = [state.vehicles[name].link_poses for name in self._vehicles]
        all_poses = b"".join([*moving, state.actors, self._still])
        return Bodies(stamp, self._names, memoryview(all_poses))
