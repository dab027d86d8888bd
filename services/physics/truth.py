# SPDX-License-Identifier: Apache-2.0
"""The ground truth of a vehicle as odometry: what every estimate is compared with.

Rule: states in, odometry out, at the rate that the scenario declares and stamped with its event as
a sensor's reading would be. Between two states nothing is interpolated: the values are those of the
first tick at or after the event. It has no error, so its covariances are zero.
"""

from __future__ import annotations

import numpy as np

from groundlink.clock import Schedule
from groundlink.frames import matrix_from_quaternion
from groundlink.messages import State, floats
from groundlink.navigation import COVARIANCE_6X6_BYTES, Odometry
from groundlink.scenario.schema import Vehicle

WORLD_FRAME = "world"
"""ENU, the frame of the scenario's placements."""

_NO_ERROR = memoryview(bytes(COVARIANCE_6X6_BYTES))


class Truth:
    """The ground truth of one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle.name
        self._child_frame = vehicle.frame_prefix + vehicle.model.base_frame
        self._schedule = Schedule.at(vehicle.ground_truth.rate_hz)
        self._next = 0

    def odometry(self, state: State) -> Odometry | None:
        """Return world_from_base and the base's velocity in its own frame, if one is due."""
        if self._schedule.tick(self._next) > state.tick:
            return None
        event, self._next = self._next, self._next + 1
        vehicle = state.vehicles[self.vehicle]
        x, y, z, qx, qy, qz, qw = vehicle.poses()[0].tolist()
        base_from_world = matrix_from_quaternion(np.array([qx, qy, qz, qw])).T
        velocities = floats(vehicle.base_velocity).reshape(2, 3) @ base_from_world.T
        linear, angular = velocities.tolist()
        return Odometry(
            stamp_nanos=state.epoch_nanos + self._schedule.nanos(event),
            frame=WORLD_FRAME,
            child_frame=self._child_frame,
            position_m=(x, y, z),
            orientation=(qx, qy, qz, qw),
            linear_mps=tuple(linear),
            angular_radps=tuple(angular),
            pose_covariance=_NO_ERROR,
            twist_covariance=_NO_ERROR,
        )
