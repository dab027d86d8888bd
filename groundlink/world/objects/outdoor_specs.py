# SPDX-License-Identifier: Apache-2.0
"""Schema of outdoor objects: houses, fences, trees, poles and small objects.

A scenario gives position and size. The loader fills in the height of the ground once, so the world
builder never reads the terrain. `outdoor_objects` turns each object into solids.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Positive, Size3, Spec

Place2 = tuple[float, float]

POST_M = 0.14
"""Thickness of a fence's posts."""


class PlacedObject(Spec, frozen=True, tag_field="kind", kw_only=True):
    """What stands at one place."""

    at_m: Place2
    yaw_deg: float = 0.0
    z_m: float | None = None
    """Height of the ground there; None: the terrain's lowest under it, 0 where there is none."""

    def reach_m(self) -> float:
        """Return how far around its place it touches the ground."""
        raise NotImplementedError

    def feet(self) -> list[Place2]:
        """Return places where it touches the ground."""
        x, y = self.at_m
        turns = [math.radians(self.yaw_deg) + math.pi * (i / 4 + 1 / 8) for i in range(8)]
        reach_m = self.reach_m()
        around = [(x + reach_m * math.cos(a), y + reach_m * math.sin(a)) for a in turns]
        return [self.at_m, *around]

    def grounded(self, heights: Sequence[float]) -> dict[str, object]:
        """Return the fields that say how high the ground is, by the heights at its feet."""
        return {"z_m": round(min(heights), 3)}


class House(PlacedObject, frozen=True, tag="house", kw_only=True):
    """Four walls under a gabled roof, closed, on a footing. Its door is amid its -y side."""

    size_m: Size3 = (10.0, 8.0, 3.2)
    """Length along the ridge, width, height of the eaves."""

    roof_deg: Annotated[float, Meta(ge=10, le=44)] = 38.0
    windows: bool = True
    door_m: tuple[Positive, Positive] = (1.1, 2.1)
    """Width and height; of a barn's as large as its gate."""

    chimney: bool = True
    wall_material: str = "plaster"
    roof_material: str = "roof_tiles"
    footing_material: str = "concrete"
    frame_material: str = "white_paint"
    door_material: str = "wood"
    glass_material: str = "glass"
    chimney_material: str = "brick"

    def reach_m(self) -> float:
        """Return how far its corners are."""
        return math.hypot(*self.size_m[:2]) / 2


class Tree(PlacedObject, frozen=True, tag="tree", kw_only=True):
    """A trunk and a crown."""

    species: Literal["oak", "birch", "spruce"] = "oak"
    """A round crown, a slender one, or tiers down to the ground."""

    height_m: Positive = 8.0
    bark_material: str = "bark"
    leaf_material: str = "leaves"

    def reach_m(self) -> float:
        """Return the radius of its trunk."""
        return 0.035 * self.height_m


class Bush(PlacedObject, frozen=True, tag="bush", kw_only=True):
    """A few balls of leaves."""

    height_m: Positive = 1.2
    leaf_material: str = "leaves"

    def reach_m(self) -> float:
        """Return how far its balls touch the ground."""
        return 0.4 * self.height_m


class Rock(PlacedObject, frozen=True, tag="rock", kw_only=True):
    """A boulder, a part of it in the ground."""

    height_m: Positive = 0.6
    material: str = "rock"

    def reach_m(self) -> float:
        """Return how wide it is about."""
        return 0.7 * self.height_m


class Pole(PlacedObject, frozen=True, tag="pole", kw_only=True):
    """A wooden telegraph pole with a crossarm along its y."""

    height_m: Positive = 7.5
    material: str = "wood"
    insulator_material: str = "white_paint"

    def reach_m(self) -> float:
        """Return its radius."""
        return 0.13


class Lamp(PlacedObject, frozen=True, tag="lamp", kw_only=True):
    """A street lamp whose head is out along its x."""

    height_m: Positive = 5.0
    material: str = "metal"
    glass_material: str = "white_paint"

    def reach_m(self) -> float:
        """Return the radius of its foot."""
        return 0.12


class Bale(PlacedObject, frozen=True, tag="bale", kw_only=True):
    """A round bale of hay on its side, its axis along y."""

    radius_m: Positive = 0.7
    length_m: Positive = 1.2
    material: str = "hay"

    def reach_m(self) -> float:
        """Return half its length."""
        return self.length_m / 2


class Crate(PlacedObject, frozen=True, tag="crate", kw_only=True):
    """A wooden crate with battens along its edges."""

    size_m: Size3 = (1.0, 0.8, 0.7)
    material: str = "wood"

    def reach_m(self) -> float:
        """Return how far its corners are."""
        return math.hypot(*self.size_m[:2]) / 2


class Fence(Spec, frozen=True, tag_field="kind", tag="fence", kw_only=True):
    """Posts along a line, and round rails between them that follow the ground."""

    points_m: Annotated[tuple[Place2, ...], Meta(min_length=2)]
    ground_m: tuple[float, ...] | None = None
    """Height of the ground at each post; None: the terrain's, 0 where there is none."""

    spacing_m: Positive = 3.0
    """Of posts, at most."""

    height_m: Positive = 1.2
    rails: Annotated[int, Meta(ge=1, le=5)] = 2
    material: str = "wood"

    def feet(self) -> list[Place2]:
        """Return the places of the posts."""
        posts = [self.points_m[0]]
        for (x0, y0), (x1, y1) in pairwise(self.points_m):
            # A hair less, so that a whole multiple of the spacing is no post more.
            bays = max(1, math.ceil(math.hypot(x1 - x0, y1 - y0) / self.spacing_m - 1e-6))
            posts += [
                (x0 + (x1 - x0) * i / bays, y0 + (y1 - y0) * i / bays) for i in range(1, bays + 1)
            ]
        return posts

    def grounded(self, heights: Sequence[float]) -> dict[str, object]:
        """Return the fields that say how high the ground is, by the heights at its feet."""
        return {"ground_m": [round(height, 3) for height in heights]}


OutdoorObject = House | Tree | Bush | Rock | Pole | Lamp | Bale | Crate | Fence
