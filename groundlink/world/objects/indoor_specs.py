# SPDX-License-Identifier: Apache-2.0
"""Schema of a furnished room: walls, a door, furniture and clutter."""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Positive, Size3, Spec


class Door(Spec, frozen=True):
    """A door opening with a leaf."""

    wall: Literal["north", "east", "south", "west"]
    """Wall with the opening."""

    at_m: float
    """Center of the opening along the wall, from the wall's middle."""

    width_m: Positive = 0.9
    """Width of the opening."""

    height_m: Positive = 2.05
    """Height of the opening."""

    open_deg: Annotated[float, Meta(ge=0, le=170)] = 80.0
    """Opening angle of the leaf, into the room."""

    material: str = "wood"
    """Material of the leaf."""


class Room(Spec, frozen=True):
    """Floor, four walls and a ceiling around the world's origin; north is +y, east is +x."""

    size_m: Size3
    """Inner length along x, width along y, height."""

    wall_thickness_m: Positive = 0.15
    """Thickness of walls, floor and ceiling."""

    wall_material: str = "plaster"
    """Material of the walls and of the ceiling."""

    floor_material: str = "linoleum"
    """Material of the floor."""

    door: Door | None = None
    """Door in one of the walls; none: a closed room."""


class Table(Spec, frozen=True, tag_field="kind", tag="table"):
    """A top on four legs."""

    at_m: tuple[float, float]
    """Center on the floor: x and y in the world."""

    yaw_deg: float = 0.0
    """Heading, counterclockwise from the world's x axis."""

    size_m: Size3 = (1.6, 0.8, 0.74)
    """Length along x, width along y, height of the top."""

    material: str = "wood"
    """Material of the table."""


class Shelf(Spec, frozen=True, tag_field="kind", tag="shelf"):
    """Boards between two uprights, open at the front (its -y side)."""

    at_m: tuple[float, float]
    """Center on the floor: x and y in the world."""

    yaw_deg: float = 0.0
    """Heading, counterclockwise from the world's x axis."""

    size_m: Size3 = (1.0, 0.35, 1.9)
    """Length along x, depth along y, height."""

    boards: Annotated[int, Meta(ge=2, le=12)] = 5
    """Number of boards, including the lowest and the highest."""

    material: str = "wood"
    """Material of the shelf."""


class Cabinet(Spec, frozen=True, tag_field="kind", tag="cabinet"):
    """A closed box on the floor."""

    at_m: tuple[float, float]
    """Center on the floor: x and y in the world."""

    yaw_deg: float = 0.0
    """Heading, counterclockwise from the world's x axis."""

    size_m: Size3 = (0.8, 0.45, 1.2)
    """Length along x, depth along y, height."""

    material: str = "metal"
    """Material of the cabinet."""


class Chair(Spec, frozen=True, tag_field="kind", tag="chair"):
    """A seat with a back on four legs."""

    at_m: tuple[float, float]
    """Center on the floor: x and y in the world."""

    yaw_deg: float = 0.0
    """Heading of a person on the chair, counterclockwise from the world's x axis."""

    material: str = "plastic"
    """Material of the chair."""


class Pillar(Spec, frozen=True, tag_field="kind", tag="pillar"):
    """A round column from floor to ceiling height."""

    at_m: tuple[float, float]
    """Center on the floor: x and y in the world."""

    radius_m: Positive = 0.2
    """Radius of the column."""

    height_m: Positive = 2.8
    """Height of the column."""

    material: str = "plaster"
    """Material of the column."""


Furniture = Table | Shelf | Cabinet | Chair | Pillar


class Clutter(Spec, frozen=True):
    """Boxes and cans placed by the seed: on tables, on shelves, on the floor along the walls."""

    count: Annotated[int, Meta(ge=0, le=2000)]
    """Number of objects."""

    size_m: tuple[Positive, Positive] = (0.05, 0.3)
    """Smallest and largest edge."""

    materials: tuple[str, ...] = ("cardboard", "plastic", "metal")
    """Materials, one of which is drawn for each object."""
