# SPDX-License-Identifier: Apache-2.0
"""What a vehicle's links look like, for those who cast rays at them or draw them.

Rule: wheels are cylinders about their link's y axis, base links are their visuals.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .solids import Cylinder, Solid

if TYPE_CHECKING:
    from groundlink.scenario.vehicle import VehicleModel

_Y_FROM_Z = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Turns a cylinder's axis from z to y."""


def links(model: VehicleModel) -> list[list[Solid]]:
    """Return the solids of each link in its frame, in the order of `VehicleState.link_poses`."""
    wheels = []
    for wheel in model.wheels:
        tyre = Cylinder(radius_m=wheel.radius_m, length_m=wheel.width_m)
        wheels.append(
            [Solid(name=wheel.name, shape=tyre, material=wheel.material, orientation=_Y_FROM_Z)]
        )
    return [list(model.visuals), *wheels]
