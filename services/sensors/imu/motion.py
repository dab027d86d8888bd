# SPDX-License-Identifier: Apache-2.0
"""Motion of an ideal IMU during each tick, from the poses of its vehicle's base.

The motion consists of the paper's finite differences (section 3.3.3) at the sensor's position,
without errors. Velocity is the difference of two positions of the sensor's origin: v(k) = (x(k) -
x(k-1)) / dt. Specific force is the difference of two velocities with gravity added: (v(k) - v(k-1))
/ dt. Angular rate is the rotation between the orientations in the middle of two successive ticks,
divided by dt.

Both differences span the states k-2, k-1 and k, so both are centered at the instant of state k-1: a
central difference has no first-order error there. They invert the physics engine's semi-implicit
Euler step, x(k) = x(k-1) + v(k) dt with v(k) = v(k-1) + a(k-1) dt, exactly. Their sums telescope:
forces to the engine's velocities v(k), rates to the orientation in the middle of a tick. The
differences are taken at the sensor's position, so they contain the centripetal and Euler terms of
the lever arm.
"""

import math
from typing import NamedTuple

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import quaternion_from_rpy
from groundlink.core.quaternions import (
    conjugate,
    from_rotation_vector,
    half_of,
    multiply,
    rotate,
    rotation_vector,
)
from groundlink.scenario.every_sensor import Mount

STANDARD_GRAVITY_MPS2 = 9.80665
"""Standard acceleration of gravity (ISO 80000-3), down along the world's z."""


class TickMotion(NamedTuple):
    """The sensor's motion in the interval (k-1, k]."""

    world_from_sensor_before: Quaternion
    """Orientation at tick k-1."""

    world_from_sensor: Quaternion
    """Orientation at tick k."""

    specific_force_mps2: Vector3
    """Acceleration minus gravity, in the sensor's frame of tick k-1. The engine applies the force
    there, and the second difference of positions is centered there."""

    angular_rate_radps: Vector3
    """Angular rate in the sensor's frame of tick k-1, centered there as the force is."""

    turn: Quaternion
    """before_from_now: the rotation from tick k-1 to tick k."""

    def orientation_at(self, fraction: float) -> Quaternion:
        """Return world_from_sensor at a fraction of the interval, at constant angular rate."""
        if fraction == 1.0:
            return self.world_from_sensor
        x, y, z = rotation_vector(self.turn)
        turned = from_rotation_vector((x * fraction, y * fraction, z * fraction))
        return multiply(self.world_from_sensor_before, turned)


class SensorMotion:
    """Convert the base's poses, one per tick, into the motion of a sensor mounted on the base."""

    def __init__(self, mount: Mount) -> None:
        roll, pitch, yaw = (math.radians(angle) for angle in mount.rpy_deg)
        self._sensor_in_base = mount.xyz_m
        self._base_from_sensor = quaternion_from_rpy(roll, pitch, yaw)
        self._pose: tuple[Vector3, Quaternion] | None = None
        self._last: tuple[Vector3, Quaternion] | None = None
        """Velocity (m/s) and half the rotation of the previous tick."""

    def advance(self, world_from_base: list[float]) -> TickMotion | None:
        """Take the base's pose at the next tick; return the motion since the last tick.

        Parameters
        ----------
        world_from_base : seven floats
            Position x, y, z in meters, then the unit quaternion x, y, z, w.

        Returns
        -------
        The motion, or None for the first two poses, because an acceleration needs three.
        """
        px, py, pz, qx, qy, qz, qw = world_from_base
        base = (qx, qy, qz, qw)
        lx, ly, lz = rotate(base, self._sensor_in_base)
        x, y, z = px + lx, py + ly, pz + lz
        orientation = multiply(base, self._base_from_sensor)

        last_pose, self._pose = self._pose, ((x, y, z), orientation)
        if last_pose is None:
            return None
        (last_x, last_y, last_z), before = last_pose
        rate = TICK_RATE_HZ
        vx, vy, vz = (x - last_x) * rate, (y - last_y) * rate, (z - last_z) * rate

        sensor_from_world = conjugate(before)
        turn = multiply(sensor_from_world, orientation)
        half = half_of(turn)

        last, self._last = self._last, ((vx, vy, vz), half)
        if last is None:
            return None
        (last_vx, last_vy, last_vz), last_half = last
        force_in_world = (
            (vx - last_vx) * rate,
            (vy - last_vy) * rate,
            (vz - last_vz) * rate + STANDARD_GRAVITY_MPS2,
        )
        rx, ry, rz = rotation_vector(multiply(last_half, half))
        return TickMotion(
            world_from_sensor_before=before,
            world_from_sensor=orientation,
            specific_force_mps2=rotate(sensor_from_world, force_in_world),
            angular_rate_radps=(rx * rate, ry * rate, rz * rate),
            turn=turn,
        )
