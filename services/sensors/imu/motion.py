# SPDX-License-Identifier: Apache-2.0
"""What an ideal IMU feels during each tick, from the poses of its vehicle's base.

Rule: the paper's finite differences (3.3.3) at the sensor's own place, and no errors. Velocity is
the difference of two positions of the sensor's origin, specific force that of two velocities with
gravity added, angular rate the rotation from one tick to the next.

These differences invert the physics engine's semi-implicit Euler step, x(k) = x(k-1) + v(k) dt with
v(k) = v(k-1) + a(k-1) dt, without an error of discretisation, and because they are taken where the
sensor sits they hold the lever arm's centripetal and Euler terms. Both quantities are constant
within a tick, as the engine's force is, and belong to the interval (k-1, k].
"""

from __future__ import annotations

import math
from typing import NamedTuple

from groundlink.clock import TICK_RATE_HZ
from groundlink.frames import quaternion_from_rpy
from groundlink.messages import Quaternion, Vector3
from groundlink.scenario.sensors import Mount

from .quaternions import conjugate, from_rotation_vector, multiply, rotate, rotation_vector

STANDARD_GRAVITY_MPS2 = 9.80665
"""Standard acceleration of gravity (ISO 80000-3), down along the world's z."""


class TickMotion(NamedTuple):
    """The sensor's motion in the interval (k-1, k]."""

    world_from_sensor_before: Quaternion
    """At tick k-1."""

    world_from_sensor: Quaternion
    """At tick k."""

    specific_force_mps2: Vector3
    """Acceleration minus gravity, in the sensor's frame of tick k-1, where the engine's force acts
    and where the second difference of positions has its centre."""

    angular_rate_radps: Vector3
    """In the sensor's frame; that of tick k-1 and of tick k alike."""

    def orientation_at(self, fraction: float) -> Quaternion:
        """Return world_from_sensor at a share of the interval, by constant angular rate."""
        if fraction == 1.0:
            return self.world_from_sensor
        x, y, z = self.angular_rate_radps
        scale = fraction / TICK_RATE_HZ
        turned = from_rotation_vector((x * scale, y * scale, z * scale))
        return multiply(self.world_from_sensor_before, turned)


class SensorMotion:
    """Turns the base's poses, one a tick, into the motion of a sensor mounted on it."""

    def __init__(self, mount: Mount) -> None:
        roll, pitch, yaw = (math.radians(angle) for angle in mount.rpy_deg)
        self._sensor_in_base = mount.xyz_m
        self._base_from_sensor = quaternion_from_rpy(roll, pitch, yaw)
        self._pose: tuple[Vector3, Quaternion] | None = None
        self._velocity: Vector3 | None = None

    def advance(self, world_from_base: list[float]) -> TickMotion | None:
        """Take the base's pose at the next tick; return the motion since the last.

        Parameters
        ----------
        world_from_base : seven floats
            Position x, y, z in metres, then the unit quaternion x, y, z, w.

        Returns
        -------
        The motion, or None for the first two poses: it takes three to see an acceleration.
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

        last_velocity, self._velocity = self._velocity, (vx, vy, vz)
        if last_velocity is None:
            return None
        last_vx, last_vy, last_vz = last_velocity
        force_in_world = (
            (vx - last_vx) * rate,
            (vy - last_vy) * rate,
            (vz - last_vz) * rate + STANDARD_GRAVITY_MPS2,
        )
        sensor_from_world = conjugate(before)
        rx, ry, rz = rotation_vector(multiply(sensor_from_world, orientation))
        return TickMotion(
            world_from_sensor_before=before,
            world_from_sensor=orientation,
            specific_force_mps2=rotate(sensor_from_world, force_in_world),
            angular_rate_radps=(rx * rate, ry * rate, rz * rate),
        )
