# SPDX-License-Identifier: Apache-2.0
"""Aerodynamic drag and damping of a vehicle's body; `vehicle.c` applies them."""

from collections.abc import Sequence
from typing import NamedTuple

from groundlink.core.fields import Vector3
from groundlink.scenario.vehicle import Payload, VehicleModel

from .urdf import chassis_moments

AIR_DENSITY_KGPM3 = 1.225
"""Standard atmosphere at sea level (ISO 2533)."""


class BodyDrag(NamedTuple):
    """Coefficients of drag and damping.

    Damping takes a share of the velocity each second, as in game engines.
    """

    drag_nspm2: float
    """Force over the square of the speed of the center of mass."""

    linear_nspm: float
    angular_nmsprad: Vector3


def body_drag(model: VehicleModel, payload: Sequence[Payload] = ()) -> BodyDrag:
    """Return drag and damping of a vehicle with its payload."""
    chassis = model.chassis
    parts = [(wheel.mass_kg, wheel.center_m) for wheel in model.wheels]
    parts += [(load.mass_kg, load.at_m) for load in payload]
    parts += [(arm.mass_kg, arm.mass_center_m) for arm in model.arms]
    mass = chassis.mass_kg + sum(part_kg for part_kg, _ in parts)
    moments = list(chassis_moments(chassis))
    for part_kg, at_m in parts:
        x, y, z = (p - c for p, c in zip(at_m, chassis.center_m, strict=True))
        for i, square in enumerate((y * y + z * z, x * x + z * z, x * x + y * y)):
            moments[i] += part_kg * square
    about_x, about_y, about_z = (chassis.angular_damping_per_s * moment for moment in moments)
    return BodyDrag(
        AIR_DENSITY_KGPM3 / 2 * chassis.drag_area_m2,
        chassis.linear_damping_per_s * mass,
        (about_x, about_y, about_z),
    )
