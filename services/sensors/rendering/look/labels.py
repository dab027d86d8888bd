# SPDX-License-Identifier: Apache-2.0
"""Labels: the object that a solid belongs to, and its class.

An object is what a person would point at: a table with its legs, a vehicle with its wheels, one
piece of clutter. Its class is its name without the number.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence

NONE = -1
"""Label of pixels without an object: the sky."""


class Labels:
    """Numbers of objects, from 0 in the order of their first solids.

    Parameters
    ----------
    own
        Solids that are objects of their own.
    actors
        Class of each actor, by its name.

    Attributes
    ----------
    instances : list of str
        Object of each number: `table_3`.
    classes : list of str
        Class of each number: `table`.
    """

    def __init__(self, own: Collection[str], actors: Mapping[str, str]) -> None:
        self._own = frozenset(own)
        self._actors = actors
        self.instances: list[str] = []
        self.classes: list[str] = []
        self._number: dict[str, int] = {}

    def of_solids(self, names: Iterable[str]) -> list[int]:
        """Return the label of each static solid."""
        things = [_thing(name, self._own) for name in names]
        return [self._label(thing, re.sub(r"_\d+$", "", thing)) for thing in things]

    def of_soils(self, terrain: str, materials: Sequence[str]) -> int:
        """Return the first label of a terrain; each material has one, and is its class."""
        first = len(self.instances)
        self.instances += [terrain] * len(materials)
        self.classes += materials
        return first

    def of_mover(self, name: str) -> int:
        """Return the label of a vehicle or an actor."""
        return self._label(name, self._actors.get(name, "vehicle"))

    def _label(self, thing: str, kind: str) -> int:
        if thing not in self._number:
            self._number[thing] = len(self.instances)
            self.instances.append(thing)
            self.classes.append(kind)
        return self._number[thing]


def _thing(solid: str, own: Collection[str]) -> str:
    """Return the object that a solid belongs to; `own` are solids that are objects of their own.

    Other solids are named by `groundlink.world.objects.indoor_objects`: `table_3_leg_0`,
    `room_floor`.
    """
    if solid in own:
        return solid
    kind, _, rest = solid.partition("_")
    part = rest.partition("_")[0]
    if kind == "room":
        return part
    return f"{kind}_{part}" if part.isdecimal() else kind
