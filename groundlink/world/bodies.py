# SPDX-License-Identifier: Apache-2.0
"""The one numbering of all bodies of a run: whoever says what a surface belongs to uses it.

Rule: first what moves: the links of all vehicles in the order of the scenario and of
`VehicleModel.link_names`, then its actors. Then what stands still, in the order of `build.solids`,
and last the terrain, where a world has one. A body's number is its place there. So the numbers of
what moves do not depend on what stands, and a replica finds both kinds by addition.

A link is called `vehicle/link`, as vehicles of one model have links of the same names, actors and
solids as they are in the world, terrain `terrain`. No two bodies have
one name: `build.solids` refuses that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from . import terrain
from .solids import Solid

if TYPE_CHECKING:
    from groundlink.scenario.schema import Scenario

NO_BODY = 2**32 - 1
"""Stands for what belongs to no body, such as rain and fog."""


def link_bodies(scenario: Scenario) -> list[str]:
    """Return the names of the bodies that move, in the order of their numbers."""
    links = [f"{v.name}/{link}" for v in scenario.vehicles for link in v.model.link_names()]
    return [*links, *(actor.name for actor in scenario.world.actors)]


def body_names(scenario: Scenario, static: Sequence[Solid]) -> tuple[str, ...]:
    """Return the names of all bodies in the order of their numbers; `static` is `build.solids`."""
    last = (terrain.BODY,) if scenario.world.terrain else ()
    return (*link_bodies(scenario), *(solid.name for solid in static), *last)
