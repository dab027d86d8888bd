# SPDX-License-Identifier: Apache-2.0
"""Solids of a vehicle's links, for ray casting and drawing.

A wheel without visuals of its own is a cylinder about the y axis of its link.
"""

import math

from groundlink.scenario.running_gear import Wheel
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Cylinder, Solid

_Y_FROM_Z = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Rotation of a cylinder's axis from z to y, as quaternion xyzw."""


def link_solids(model: VehicleModel) -> list[list[Solid]]:
    """Return the solids of each link in its frame, in the order of `VehicleState.link_poses`."""
    wheels = (list(wheel.visuals) or [_tire(wheel)] for wheel in model.wheels)
    return [list(model.visuals), *wheels, *(list(joint.visuals) for joint in model.joints)]


def _tire(wheel: Wheel) -> Solid:
    shape = Cylinder(radius_m=wheel.radius_m, length_m=wheel.width_m)
    return Solid(name=wheel.name, shape=shape, material=wheel.material, orientation=_Y_FROM_Z)
