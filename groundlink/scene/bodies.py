# SPDX-License-Identifier: Apache-2.0
"""Body numbers of a run, and the solids of a vehicle's links.

Moving bodies come first: the links of all vehicles (in the order of the scenario and of
`VehicleModel.link_names`), then the actors. Static solids follow in the order of `build.solids`,
and the terrain is last. The numbers of moving bodies therefore do not depend on the static world.

A link is named `vehicle/link`; actors and solids have their own names. Names are unique:
`build.solids` refuses duplicates.
"""

import math
from collections.abc import Sequence

from groundlink.scenario.running_gear import Wheel
from groundlink.scenario.schema import Scenario
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world import terrain
from groundlink.world.solids import Cylinder, Solid

NO_BODY = 2**32 - 1
"""Body number of hits on no body, such as rain and fog."""


def link_bodies(scenario: Scenario) -> list[str]:
    """Return the names of the moving bodies in the order of their numbers."""
    links = [f"{v.name}/{link}" for v in scenario.vehicles for link in v.model.link_names()]
    return [*links, *(actor.name for actor in scenario.world.actors)]


def body_names(scenario: Scenario, static: Sequence[Solid]) -> tuple[str, ...]:
    """Return the names of all bodies in the order of their numbers; `static` is `build.solids`."""
    last = (terrain.BODY,) if scenario.world.terrain else ()
    return (*link_bodies(scenario), *(solid.name for solid in static), *last)


_Y_FROM_Z = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Rotation of a cylinder's axis from z to y, as quaternion xyzw."""


def link_solids(model: VehicleModel) -> list[list[Solid]]:
    """Return the solids of each link in its frame, in the order of `VehicleState.link_poses`.

    A wheel without visuals of its own is a cylinder about the y axis of its link.
    """
    wheels = (list(wheel.visuals) or [_tire(wheel)] for wheel in model.wheels)
    joints = (list(joint.visuals) for joint in model.joints)
    return [list(model.visuals), *wheels, *joints, *(list(arm.visuals) for arm in model.arms)]


def _tire(wheel: Wheel) -> Solid:
    shape = Cylinder(radius_m=wheel.radius_m, length_m=wheel.width_m)
    return Solid(name=wheel.name, shape=shape, material=wheel.material, orientation=_Y_FROM_Z)
