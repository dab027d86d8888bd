# SPDX-License-Identifier: Apache-2.0
"""What is added to a run: objects with their materials, and solids that are one entity."""

from msgspec import field

from groundlink.core.fields import Quaternion, Spec, Vector3
from groundlink.world.actors import Actor, Category
from groundlink.world.solids import Material, Solid

from .schema import Vehicle


class Addition(Spec, frozen=True):
    """Objects to be added to the world of a run."""

    solids: tuple[Solid, ...] = ()
    actors: tuple[Actor, ...] = ()
    vehicles: tuple[Vehicle, ...] = ()
    materials: dict[str, Material] = field(default_factory=dict)
    """Materials of the added objects. A material of the world with the same name takes precedence.
    """

    def names(self) -> list[str]:
        """Return the names of the added objects."""
        vehicles, actors = (v.name for v in self.vehicles), (a.name for a in self.actors)
        return [*vehicles, *actors, *(solid.name for solid in self.solids)]


class SolidGroup(Spec, frozen=True):
    """Static solids that were spawned together, as one entity."""

    name: str
    parts: tuple[str, ...]
    """Names of the solids."""

    position_m: Vector3
    """World from the frame of the group."""

    orientation: Quaternion
    category: Category = "static_object"
