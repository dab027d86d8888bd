# SPDX-License-Identifier: Apache-2.0
"""Schema of outdoor objects: houses, fences, trees, poles and small objects.

A scenario gives position and size. The loader fills in the height of the ground once, so the world
builder never reads the terrain. `outdoor_objects` turns each object into solids.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal

from msgspec import Meta

from groundlink.core.fields import Positive, Size3, Spec

Place2 = tuple[float, float]

POST_M = 0.14
"""Thickness of a fence's posts."""


class PlacedObject(Spec, frozen=True, tag_field="kind", kw_only=True):
    """An object at one place."""

    at_m: Place2
    """Center on the ground: x and y in the world."""

    yaw_deg: float = 0.0
    """Heading, counterclockwise from the world's x axis."""

    z_m: float | None = None
    """Height of the ground; None: the lowest terrain below the object, or 0 without terrain."""

    def feet(self) -> list[Place2]:
        """Return the points where the object touches the ground."""
        x, y = self.at_m
        turns = [math.radians(self.yaw_deg) + math.pi * (i / 4 + 1 / 8) for i in range(8)]
        reach_m = FOOTPRINTS_M[type(self)](self)
        around = [(x + reach_m * math.cos(a), y + reach_m * math.sin(a)) for a in turns]
        return [self.at_m, *around]

    def ground_fields(self, heights: Sequence[float]) -> dict[str, object]:
        """Return the fields for the height of the ground, from the heights at `feet`."""
        return {"z_m": round(min(heights), 3)}


class House(PlacedObject, frozen=True, tag="house", kw_only=True):
    """A closed house with a gabled roof on a footing; the door is in the middle of the -y side."""

    size_m: Size3 = (10.0, 8.0, 3.2)
    """Length along the ridge, width, height of the eaves."""

    roof_deg: Annotated[float, Meta(ge=10, le=44)] = 38.0
    """Slope of the roof."""

    windows: bool = True
    """Whether the house has windows."""

    door_m: tuple[Positive, Positive] = (1.1, 2.1)
    """Width and height of the door."""

    chimney: bool = True
    """Whether the house has a chimney."""

    wall_material: str = "plaster"
    """Material of the walls."""

    roof_material: str = "roof_tiles"
    """Material of the roof."""

    footing_material: str = "concrete"
    """Material of the footing and of the steps."""

    frame_material: str = "white_paint"
    """Material of the frames of windows and door."""

    door_material: str = "wood"
    """Material of the door."""

    glass_material: str = "glass"
    """Material of the window panes."""

    chimney_material: str = "brick"
    """Material of the chimney."""


class Tree(PlacedObject, frozen=True, tag="tree", kw_only=True):
    """A trunk and a crown."""

    species: Literal["oak", "birch", "spruce"] = "oak"
    """Shape of the crown. `oak`: round. `birch`: slender. `spruce`: tiers down to the ground."""

    height_m: Positive = 8.0
    """Height of the tree above the ground."""

    bark_material: str = "bark"
    """Material of the trunk."""

    leaf_material: str = "leaves"
    """Material of the crown."""


class Bush(PlacedObject, frozen=True, tag="bush", kw_only=True):
    """A few spheres of leaves."""

    height_m: Positive = 1.2
    """Height of the bush above the ground."""

    leaf_material: str = "leaves"
    """Material of the leaves."""


class Rock(PlacedObject, frozen=True, tag="rock", kw_only=True):
    """A boulder, partly in the ground."""

    height_m: Positive = 0.6
    """Height of the boulder; its other lengths are proportional."""

    material: str = "rock"
    """Material of the rock."""


class Pole(PlacedObject, frozen=True, tag="pole", kw_only=True):
    """A wooden telegraph pole with a crossarm along its y."""

    height_m: Positive = 7.5
    """Height of the pole above the ground."""

    material: str = "wood"
    """Material of the pole and of the crossarm."""

    insulator_material: str = "white_paint"
    """Material of the insulators."""


class Lamp(PlacedObject, frozen=True, tag="lamp", kw_only=True):
    """A street lamp with its head along +x."""

    height_m: Positive = 5.0
    """Height of the post above the ground."""

    material: str = "metal"
    """Material of the post."""

    glass_material: str = "white_paint"
    """Material of the lamp's glass."""


class Bale(PlacedObject, frozen=True, tag="bale", kw_only=True):
    """A round bale of hay on its side, its axis along y."""

    radius_m: Positive = 0.7
    """Radius of the bale."""

    length_m: Positive = 1.2
    """Length of the bale along its axis."""

    material: str = "hay"
    """Material of the bale."""


class Crate(PlacedObject, frozen=True, tag="crate", kw_only=True):
    """A wooden crate with battens along its edges."""

    size_m: Size3 = (1.0, 0.8, 0.7)
    """Length along x, width along y, height."""

    material: str = "wood"
    """Material of the crate."""


class Fence(Spec, frozen=True, tag_field="kind", tag="fence", kw_only=True):
    """Posts along a line, with round rails that follow the ground."""

    points_m: Annotated[tuple[Place2, ...], Meta(min_length=2)]
    """Corners of the line: x and y in the world."""

    ground_m: tuple[float, ...] | None = None
    """Height of the ground at each post; None: from the terrain, or 0 without terrain."""

    spacing_m: Positive = 3.0
    """Largest distance between posts."""

    height_m: Positive = 1.2
    """Height of the posts above the ground."""

    rails: Annotated[int, Meta(ge=1, le=5)] = 2
    """Number of rails, one above the other."""

    material: str = "wood"
    """Material of the posts and rails."""

    def feet(self) -> list[Place2]:
        """Return the positions of the posts."""
        posts = [self.points_m[0]]
        for (x0, y0), (x1, y1) in pairwise(self.points_m):
            # Rounded down slightly, so that an exact multiple of the spacing adds no post.
            bays = max(1, math.ceil(math.hypot(x1 - x0, y1 - y0) / self.spacing_m - 1e-6))
            posts += [
                (x0 + (x1 - x0) * i / bays, y0 + (y1 - y0) * i / bays) for i in range(1, bays + 1)
            ]
        return posts

    def ground_fields(self, heights: Sequence[float]) -> dict[str, object]:
        """Return the fields for the height of the ground, from the heights at `feet`."""
        return {"ground_m": [round(height, 3) for height in heights]}


OutdoorObject = House | Tree | Bush | Rock | Pole | Lamp | Bale | Crate | Fence

FOOTPRINTS_M: dict[type[PlacedObject], Callable[[Any], float]] = {
    House: lambda house: math.hypot(*house.size_m[:2]) / 2,
    Tree: lambda tree: 0.035 * tree.height_m,
    Bush: lambda bush: 0.4 * bush.height_m,
    Rock: lambda rock: 0.7 * rock.height_m,
    Pole: lambda _: 0.13,
    Lamp: lambda _: 0.12,
    Bale: lambda bale: bale.length_m / 2,
    Crate: lambda crate: math.hypot(*crate.size_m[:2]) / 2,
}
"""Radius within which an object of each kind touches the ground."""
