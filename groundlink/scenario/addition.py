# SPDX-License-Identifier: Apache-2.0
"""What can be added to a run under way: solids, actors and vehicles."""

from __future__ import annotations

import msgspec

from groundlink.world.actors import Actor
from groundlink.world.solids import Material, Solid

from .schema import Vehicle


class Addition(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is added to a scenario."""

    solids: tuple[Solid, ...] = ()
    actors: tuple[Actor, ...] = ()
    vehicles: tuple[Vehicle, ...] = ()
    materials: dict[str, Material] = {}
    """What it is made of; where the world has one of that name, the world's counts."""

    def names(self) -> list[str]:
        """Return what its things are called."""
        vehicles, actors = (v.name for v in self.vehicles), (a.name for a in self.actors)
        return [*vehicles, *actors, *(solid.name for solid in self.solids)]
