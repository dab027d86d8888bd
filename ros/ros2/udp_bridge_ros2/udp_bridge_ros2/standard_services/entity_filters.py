# SPDX-License-Identifier: Apache-2.0
"""Filters of entities by name, category, tags and bounds. All of them must accept an entity."""

from __future__ import annotations

import re
from typing import NamedTuple

from .overlap import ConvexRegion
from .world_queries import Entity

_POINT = (0.0, 0.0, 0.0)


class TagSelection(NamedTuple):
    """Accepts what has any of some tags, or all of them; without tags everything."""

    tags: frozenset[str] = frozenset()
    needs_all: bool = False

    def accepts(self, tags: tuple[str, ...]) -> bool:
        """Return whether tags match."""
        found = self.tags.intersection(tags)
        return found == self.tags if self.needs_all or not self.tags else bool(found)


class EntitySelection(NamedTuple):
    """Accepts entities; what is None or empty accepts all."""

    name: re.Pattern[str] | None = None
    """Matches whole names."""
    categories: frozenset[str] = frozenset()
    tags: TagSelection = TagSelection()
    region: ConvexRegion | None = None
    """In the frame of the world."""

    def accepts(self, entity: Entity) -> bool:
        """Return whether an entity matches."""
        return (
            (self.name is None or self.name.fullmatch(entity.name) is not None)
            and (not self.categories or entity.category in self.categories)
            and self.tags.accepts(entity.tags)
            and (
                self.region is None
                or self.region.overlaps(
                    entity.position_m,
                    entity.orientation,
                    entity.low_m or _POINT,
                    entity.high_m or _POINT,
                )
            )
        )
