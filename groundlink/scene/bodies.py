# SPDX-License-Identifier: Apache-2.0
"""Body numbers of a run.

Moving bodies come first: the links of all vehicles (in the order of the scenario and of
`VehicleModel.link_names`), then the actors. Static solids follow in the order of `build.solids`,
and the terrain is last. The numbers of moving bodies therefore do not depend on the static world.

A link is named `vehicle/link`; actors and solids have their own names. Names are unique:
`build.solids` refuses duplicates.
"""

from collections.abc import Sequence

from groundlink.scenario.schema import Scenario
from groundlink.world import terrain
from groundlink.world.solids import Solid

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
