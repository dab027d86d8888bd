# SPDX-License-Identifier: Apache-2.0
"""Aerodynamic drag and damping of a vehicle's body."""

from math import sqrt

from groundlink.core.fields import Vector3
from groundlink.scenario.vehicle import VehicleModel

from .urdf import chassis_moments

AIR_DENSITY_KGPM3 = 1.225
"""Standard atmosphere at sea level (ISO 2533)."""


class BodyDrag:
    """Aerodynamic drag and damping of one vehicle.

    All vectors are in the base frame. Damping takes a share of the velocity each second, as in game
    engines.
    """

    def __init__(self, model: VehicleModel) -> None:
        chassis, wheels = model.chassis, model.wheels
        self._com = chassis.center_m
        self._drag = AIR_DENSITY_KGPM3 / 2 * chassis.drag_area_m2
        mass = chassis.mass_kg + sum(wheel.mass_kg for wheel in wheels)
        self._linear = chassis.linear_damping_per_s * mass
        moments = list(chassis_moments(chassis))
        for wheel in wheels:
            x, y, z = (w - c for w, c in zip(wheel.center_m, chassis.center_m, strict=True))
            for i, square in enumerate((y * y + z * z, x * x + z * z, x * x + y * y)):
                moments[i] += wheel.mass_kg * square
        self._angular = [chassis.angular_damping_per_s * moment for moment in moments]

    def slow(
        self, force: Vector3, torque: Vector3, velocity: Vector3, turn: Vector3
    ) -> tuple[Vector3, Vector3]:
        """Add drag and damping to force and torque on the center of mass.

        Parameters
        ----------
        velocity, turn
            velocities of the base's origin, m/s and rad/s.
        """
        (x, y, z), (ox, oy, oz) = self._com, turn
        vx = velocity[0] + oy * z - oz * y
        vy = velocity[1] + oz * x - ox * z
        vz = velocity[2] + ox * y - oy * x
        push = self._linear + self._drag * sqrt(vx * vx + vy * vy + vz * vz)
        ax, ay, az = self._angular
        return (
            (force[0] - push * vx, force[1] - push * vy, force[2] - push * vz),
            (torque[0] - ax * ox, torque[1] - ay * oy, torque[2] - az * oz),
        )


def body_drag(model: VehicleModel) -> BodyDrag | None:
    """Return drag and damping of a vehicle, None if it has neither."""
    chassis = model.chassis
    resists = (chassis.drag_area_m2, chassis.linear_damping_per_s, chassis.angular_damping_per_s)
    return BodyDrag(model) if any(resists) else None
