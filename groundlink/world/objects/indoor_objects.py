# SPDX-License-Identifier: Apache-2.0
"""Rooms and furniture as boxes and cylinders.

Each kind is one function that yields its parts around its own origin on the floor.
"""

from collections.abc import Callable, Iterator
from typing import Any

from groundlink.core.fields import Vector3
from groundlink.world.solids import Solid

from .indoor_specs import Cabinet, Chair, Door, Furniture, Pillar, Room, Shelf, Table
from .local_frame import LocalFrame, SupportSurface

BOARD_M = 0.025
"""Thickness of table tops, boards, uprights and seats."""

LEG_M = 0.05
LEAF_M = 0.04
LEAF_GAP_M = 0.005
APRON_M = 3.0
"""Floor beyond the walls, for vehicles that leave through the door."""

CHAIR_SIZE_M = (0.44, 0.44, 0.85)
SEAT_HEIGHT_M = 0.46

WALLS = {"north": (0.0, 1), "west": (90.0, 1), "south": (180.0, -1), "east": (-90.0, -1)}
"""For each wall, the yaw (degrees) of a frame with x along the wall and y out of the room, and the
sign of that x in the world."""


Parts = Iterator[Solid | SupportSurface]
"""Solids of a piece of furniture, and the surfaces that it offers to clutter."""


def build_room(room: Room) -> list[Solid]:
    """Return floor, ceiling, walls with the door opening, and the door leaf."""
    length, width, height = room.size_m
    t = room.wall_thickness_m
    frame = LocalFrame("room")
    slab = (length + 2 * APRON_M, width + 2 * APRON_M, t)
    cover = (length + 2 * t, width + 2 * t, t)
    solids = [
        frame.box("floor", slab, (0, 0, -t / 2), room.floor_material),
        frame.box("ceiling", cover, (0, 0, height + t / 2), room.wall_material),
    ]
    for name, (yaw_deg, _) in WALLS.items():
        along, across = _lengths(room, name)
        # The north and south walls reach around the corners, the others fit between them.
        half = along / 2 + (t if name in ("north", "south") else 0.0)
        # Pieces as (part, from, to, bottom): from and to along the wall.
        pieces = [("whole", -half, half, 0.0)]
        if room.door and room.door.wall == name:
            left, right = _span(room.door)
            pieces = [
                ("left", -half, left, 0.0),
                ("right", right, half, 0.0),
                ("lintel", left, right, room.door.height_m),
            ]
        wall = LocalFrame(f"wall_{name}", yaw_deg=yaw_deg)
        for part, start, end, bottom in pieces:
            size = (end - start, t, height - bottom)
            at = ((start + end) / 2, (across + t) / 2, (bottom + height) / 2)
            solids.append(wall.box(part, size, at, room.wall_material))
    return [*solids, _leaf(room, room.door)] if room.door else solids


def door_frame(room: Room, door: Door) -> LocalFrame:
    """Return the frame in the middle of the opening, at the wall's inner face; y points out."""
    yaw_deg, _ = WALLS[door.wall]
    along = LocalFrame("door", yaw_deg=yaw_deg)
    x, y, _ = along.point(sum(_span(door)) / 2, _lengths(room, door.wall)[1] / 2, 0)
    return LocalFrame("door", x, y, yaw_deg=yaw_deg)


def _leaf(room: Room, door: Door) -> Solid:
    """Return the door leaf, hinged at the start of the opening; it opens into the room."""
    opening = door_frame(room, door)
    x, y, _ = opening.point(-door.width_m / 2, 0, 0)
    hinge = LocalFrame("door", x, y, yaw_deg=opening.yaw_deg - door.open_deg)
    size = (door.width_m - 2 * LEAF_GAP_M, LEAF_M, door.height_m - 2 * LEAF_GAP_M)
    # A closed leaf lies within the opening; an open one clears the wall.
    side = -1 if 0 < door.open_deg <= 90 else 1
    at = (door.width_m / 2, side * LEAF_M / 2, door.height_m / 2)
    return hinge.box("leaf", size, at, door.material)


def _lengths(room: Room, wall: str) -> tuple[float, float]:
    """Return the room's inner lengths along a wall and across it."""
    length, width, _ = room.size_m
    return (length, width) if wall in ("north", "south") else (width, length)


def _span(door: Door) -> tuple[float, float]:
    """Return the begin and end of the opening along the x axis of the wall's frame."""
    at = door.at_m * WALLS[door.wall][1]
    return at - door.width_m / 2, at + door.width_m / 2


def _legs(frame: LocalFrame, size: Vector3, material: str) -> Iterator[Solid]:
    """Yield four legs at the corners of a rectangle."""
    length, width, height = size
    x, y = length / 2 - LEG_M / 2, width / 2 - LEG_M / 2
    for i, (sx, sy) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        at = (sx * x, sy * y, height / 2)
        yield frame.box(f"leg_{i}", (LEG_M, LEG_M, height), at, material)


def _table(frame: LocalFrame, table: Table) -> Parts:
    length, width, height = table.size_m
    top = (length, width, BOARD_M)
    yield frame.box("top", top, (0, 0, height - BOARD_M / 2), table.material)
    yield from _legs(frame, (length, width, height - BOARD_M), table.material)
    yield frame.surface((0, 0, height), length, width, 1.0)


def _shelf(frame: LocalFrame, shelf: Shelf) -> Parts:
    length, width, height = shelf.size_m
    inner, depth = length - 2 * BOARD_M, width - BOARD_M
    for i, side in enumerate((1, -1)):
        at = (side * (length - BOARD_M) / 2, 0.0, height / 2)
        yield frame.box(f"upright_{i}", (BOARD_M, width, height), at, shelf.material)
    back = (inner, BOARD_M, height)
    yield frame.box("back", back, (0, (width - BOARD_M) / 2, height / 2), shelf.material)
    pitch = (height - BOARD_M) / (shelf.boards - 1)
    for i in range(shelf.boards):
        y, bottom = -BOARD_M / 2, i * pitch
        at = (0.0, y, bottom + BOARD_M / 2)
        yield frame.box(f"board_{i}", (inner, depth, BOARD_M), at, shelf.material)
        clear = pitch - BOARD_M if i < shelf.boards - 1 else 0.4
        yield frame.surface((0, y, bottom + BOARD_M), inner, depth, clear)


def _cabinet(frame: LocalFrame, cabinet: Cabinet) -> Parts:
    yield frame.box("body", cabinet.size_m, (0, 0, cabinet.size_m[2] / 2), cabinet.material)


def _chair(frame: LocalFrame, chair: Chair) -> Parts:
    length, width, height = CHAIR_SIZE_M
    yield from _legs(frame, (length, width, SEAT_HEIGHT_M - BOARD_M), chair.material)
    seat, back = (length, width, BOARD_M), (BOARD_M, width, height - SEAT_HEIGHT_M)
    yield frame.box("seat", seat, (0, 0, SEAT_HEIGHT_M - BOARD_M / 2), chair.material)
    at = ((BOARD_M - length) / 2, 0.0, (height + SEAT_HEIGHT_M) / 2)
    yield frame.box("back", back, at, chair.material)


def _pillar(frame: LocalFrame, pillar: Pillar) -> Parts:
    height = pillar.height_m
    yield frame.cylinder("column", pillar.radius_m, height, (0, 0, height / 2), pillar.material)


BUILDERS: dict[type[Any], Callable[[LocalFrame, Any], Parts]] = {
    Table: _table,
    Shelf: _shelf,
    Cabinet: _cabinet,
    Chair: _chair,
    Pillar: _pillar,
}
"""Builder of each kind of furniture."""


def build_furniture(index: int, furniture: Furniture) -> tuple[list[Solid], list[SupportSurface]]:
    """Return the solids of a piece of furniture, and the surfaces that it offers to clutter."""
    name = f"{furniture.__struct_config__.tag}_{index}"
    frame = LocalFrame(name, *furniture.at_m, yaw_deg=getattr(furniture, "yaw_deg", 0.0))
    parts = list(BUILDERS[type(furniture)](frame, furniture))
    solids = [part for part in parts if isinstance(part, Solid)]
    return solids, [part for part in parts if isinstance(part, SupportSurface)]
