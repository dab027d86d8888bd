# SPDX-License-Identifier: Apache-2.0
"""The one numbering of all bodies of a run: whoever says what a surface belongs to uses it.

Rule: first what moves, the links of all vehicles in the order of the scenario and of
`VehicleModel.link_names`, then what stands still, in the order of `build.solids`. A body's number
is its place there. So the numbers of links do not depend on the world, and a replica finds both
kinds by addition.

A link is called `vehicle/link`, as vehicles of one model have links of the same names, a solid as
it is in the world. No two bodies have one name: `build.solids` refuses a solid with that of a link.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .solids import Solid

if TYPE_CHECKING:
    from groundlink.scenario.schema import Scenario

NO_BODY = 2**32 - 1
"""Stands for what belongs to no body, such as rain and fog."""


def link_bodies(scenario: Scenario) -> list[str]:
    """Return the names of the bodies that move, in the order of their numbers."""
    return [f"{v.name}/{link}" for v in scenario.vehicles for link in v.model.link_names()]


def body_names(scenario: Scenario, static: Sequence[Solid]) -> tuple[str, ...]:
    """Return the names of all bodies in the order of their numbers; `static` is `build.solids`."""
    return (*link_bodies(scenario), *(solid.name for solid in static))
