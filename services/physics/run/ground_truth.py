# SPDX-License-Identifier: Apache-2.0
"""Ground truth of vehicles, bodies and the world's map as messages that map to ROS types.

Messages have the declared rate and the stamps of their instants, as a sensor's readings would. For
an instant between two ticks the states of both are interpolated. Covariances are zero.
"""

import struct
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS, Schedule
from groundlink.core.frames import IDENTITY_QUATERNION, nlerp
from groundlink.core.quaternions import conjugate, rotate
from groundlink.messages.base import State, VehicleState, floats, packed
from groundlink.messages.ground_truth import WORLD_FRAME, Bodies
from groundlink.messages.navigation import (
    COVARIANCE_6X6_BYTES,
    JointState,
    OccupancyGrid,
    Odometry,
)
from groundlink.scenario.ros_side import TrueMap
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.bodies import body_names
from groundlink.scene.true_map import true_map
from groundlink.world.solids import Solid

_ACTORS = "/actors"
"""Key of the actors, beside names of vehicles, which have no slash."""

_POSE, _VELOCITY = struct.Struct("<7d"), struct.Struct("<6d")

_NO_ERROR = memoryview(bytes(COVARIANCE_6X6_BYTES))


class _Instant(NamedTuple):
    """An instant at which a message is due."""

    stamp_nanos: int
    fraction: float
    """Between the tick before, 0, and that of the state, 1."""


class _Instants:
    """Instants at a rate, from a tick on.

    Attributes
    ----------
    next_tick
        from which on states are needed for the next instant; the one before it, too, unless a tick
        is at the instant.
    """

    def __init__(self, rate_hz: float, from_tick: int = 0) -> None:
        self._schedule = Schedule.at(rate_hz)
        self._next = self._schedule.first_at_or_after(from_tick) - 1
        self._advance()

    def _advance(self) -> None:
        self._next += 1
        self._due_tick = self._schedule.tick(self._next)
        self._nanos = self._schedule.nanos(self._next)
        self.next_tick = self._due_tick - (self._nanos < self._due_tick * TICK_NANOS)

    def at(self, state: State) -> _Instant | None:
        """Return the next instant if this state is the first at or after it."""
        if state.tick < self._due_tick:
            return None
        nanos = self._nanos
        self._advance()
        return _Instant(state.epoch_nanos + nanos, 1 - (state.sim_nanos - nanos) / TICK_NANOS)


def _between(before: memoryview, after: memoryview, fraction: float) -> memoryview:
    """Interpolate float64 values between two ticks."""
    first, second = floats(before), floats(after)
    return packed(first + fraction * (second - first))


def _poses_between(before: memoryview, after: memoryview, fraction: float) -> memoryview:
    """Interpolate poses between two ticks, rows of x, y, z, qx, qy, qz, qw."""
    first, second = (floats(poses).reshape(-1, 7) for poses in (before, after))
    poses = first + fraction * (second - first)
    poses[:, 3:] = nlerp(first[:, 3:], second[:, 3:], np.full(len(first), fraction))
    return packed(poses)


class VehicleTruth:
    """The ground truth of one vehicle.

    Parameters
    ----------
    from_tick
        the first tick at which the vehicle is there.
    """

    def __init__(self, vehicle: Vehicle, from_tick: int = 0) -> None:
        self.vehicle = vehicle.name
        self._child_frame = vehicle.frame_prefix + vehicle.model.base_frame
        self._wheels = tuple(wheel.name for wheel in vehicle.model.wheels)
        self.joint_names = vehicle.true_joints
        """Of the joints that `joints` returns: servo joints, then steering joints."""

        self._has_steering = len(self.joint_names) > len(vehicle.model.moving_names)
        self._instants = _Instants(vehicle.ground_truth.rate_hz, from_tick)
        self._before: VehicleState | None = None

    @property
    def next_tick(self) -> int:
        """The tick of the next state that it needs."""
        return self._instants.next_tick

    def due(self, state: State) -> tuple[int, VehicleState] | None:
        """Return stamp and state of the vehicle at an instant that is due; else None.

        To be called for every state from `next_tick` on.
        """
        instant, after, before = (
            self._instants.at(state),
            state.vehicles[self.vehicle],
            self._before,
        )
        self._before = after
        if instant is None:
            return None
        if instant.fraction == 1.0 or before is None:
            return instant.stamp_nanos, after
        at = instant.fraction
        return instant.stamp_nanos, VehicleState(
            link_poses=_poses_between(before.link_poses, after.link_poses, at),
            base_velocity=_between(before.base_velocity, after.base_velocity, at),
            joint_positions=_between(before.joint_positions, after.joint_positions, at),
            joint_velocities=_between(before.joint_velocities, after.joint_velocities, at),
            servo_positions=_between(before.servo_positions, after.servo_positions, at),
            servo_velocities=after.servo_velocities,
        )

    def odometry(self, vehicle: VehicleState, stamp_nanos: int) -> Odometry:
        """Return world_from_base and the base's velocity in its own frame."""
        x, y, z, *world_from_base = _POSE.unpack_from(vehicle.link_poses)
        base_from_world = conjugate(tuple(world_from_base))
        vx, vy, vz, wx, wy, wz = _VELOCITY.unpack(vehicle.base_velocity)
        return Odometry(
            stamp_nanos=stamp_nanos,
            frame=WORLD_FRAME,
            child_frame=self._child_frame,
            position_m=(x, y, z),
            orientation=tuple(world_from_base),
            linear_mps=rotate(base_from_world, (vx, vy, vz)),
            angular_radps=rotate(base_from_world, (wx, wy, wz)),
            pose_covariance=_NO_ERROR,
            twist_covariance=_NO_ERROR,
        )

    def wheels(self, vehicle: VehicleState, torques: memoryview, stamp_nanos: int) -> JointState:
        """Return each wheel's angle and speed, and the torque of its motor, float64 in N m.

        A torque is constant during a step, so it is not interpolated.
        """
        return JointState(
            stamp_nanos=stamp_nanos,
            frame=self._child_frame,
            names=self._wheels,
            positions=vehicle.joint_positions,
            velocities=vehicle.joint_velocities,
            efforts=torques,
        )

    def joints(
        self, vehicle: VehicleState, steering: tuple[memoryview, memoryview], stamp_nanos: int
    ) -> JointState:
        """Return positions and speeds of the joints other than wheels.

        Parameters
        ----------
        steering
            angles and speeds of the steering joints at the last tick; they are not interpolated.
        """
        angles, speeds = steering if self._has_steering else (b"", b"")
        return JointState(
            stamp_nanos=stamp_nanos,
            frame=self._child_frame,
            names=self.joint_names,
            positions=memoryview(bytes(vehicle.servo_positions) + bytes(angles)),
            velocities=memoryview(bytes(vehicle.servo_velocities) + bytes(speeds)),
            efforts=memoryview(b""),
        )


class BodyTruth:
    """Ground truth of all bodies of the run, from a tick on."""

    def __init__(self, scenario: Scenario, static: Sequence[Solid], *, from_tick: int = 0) -> None:
        self._instants = _Instants(scenario.bodies.rate_hz, from_tick)
        self._before: dict[str, memoryview] = {}
        self.change(scenario, static)

    def change(self, scenario: Scenario, static: Sequence[Solid]) -> None:
        """Switch to the bodies of another world."""
        self._vehicles = [vehicle.name for vehicle in scenario.vehicles]
        self._names = body_names(scenario, static)
        still = [(*solid.position_m, *solid.orientation) for solid in static]
        if scenario.world.terrain:
            still.append((*scenario.world.terrain.at_m, *IDENTITY_QUATERNION))
        self._still = np.array(still, np.float64).tobytes()

    @property
    def next_tick(self) -> int:
        """The tick of the next state that it needs."""
        return self._instants.next_tick

    def poses(self, state: State) -> Bodies | None:
        """Return world_from_body of every body, if it is due.

        To be called for every state from `next_tick` on.
        """
        instant, before = self._instants.at(state), self._before
        after = {name: state.vehicles[name].link_poses for name in self._vehicles}
        after[_ACTORS] = state.actors
        self._before = after
        if instant is None:
            return None
        if instant.fraction < 1.0:
            # A body that was just added has no state before.
            after = {
                name: _poses_between(before[name], poses, instant.fraction)
                if name in before and before[name].nbytes == poses.nbytes
                else poses
                for name, poses in after.items()
            }
        all_poses = b"".join([*after.values(), self._still])
        return Bodies(instant.stamp_nanos, self._names, memoryview(all_poses))


class MapTruth:
    """The true map of a run's world; computed once for each world.

    Parameters
    ----------
    spec
        which map a scenario asks for.
    """

    def __init__(
        self, spec: TrueMap, scenario: Scenario, static: Sequence[Solid], *, from_tick: int = 0
    ) -> None:
        self._spec = spec
        self._instants = _Instants(spec.rate_hz, from_tick)
        self.change(scenario, static)

    def change(self, scenario: Scenario, static: Sequence[Solid]) -> None:
        """Switch to the map of another world."""
        spec = self._spec
        found = true_map(scenario, static, resolution_m=spec.resolution_m, heights_m=spec.heights_m)
        grid = found.grid
        self._map = OccupancyGrid(
            stamp_nanos=0,
            frame=spec.frame,
            loaded_nanos=0,
            resolution_m=grid.resolution_m,
            width=grid.columns,
            height=grid.rows,
            origin_position_m=(grid.x_m, grid.y_m, 0.0),
            origin_orientation=IDENTITY_QUATERNION,
            cells=packed(found.cells),
        )

    @property
    def next_tick(self) -> int:
        """The tick of the next state that it needs."""
        return self._instants.next_tick

    def due(self, state: State) -> OccupancyGrid | None:
        """Return the map if it is due; to be called for every state from `next_tick` on."""
        instant = self._instants.at(state)
        if instant is None:
            return None
        return replace(self._map, stamp_nanos=instant.stamp_nanos, loaded_nanos=state.epoch_nanos)


class NoMapTruth(MapTruth):
    """No map, in a scenario that does not ask for one."""

    next_tick = sys.maxsize

    def __init__(self) -> None:
        pass

    def change(self, scenario: Scenario, static: Sequence[Solid]) -> None:
        """Do nothing."""

    def due(self, state: State) -> None:
        """Return None: no map is ever due."""


def map_truth(scenario: Scenario, static: Sequence[Solid], *, from_tick: int = 0) -> MapTruth:
    """Return the true map of a scenario, or its stand-in."""
    spec = scenario.true_map
    if spec is None:
        return NoMapTruth()
    return MapTruth(spec, scenario, static, from_tick=from_tick)
