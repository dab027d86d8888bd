# SPDX-License-Identifier: Apache-2.0
"""Walls and furniture as boxes and cylinders.

Rule: each kind is one function from its description to solids around its own origin on the floor;
`LocalFrame.put` places them in the world. Numbers are rounded to a micrometre and 1e-9 of a
quaternion: sine and cosine differ in the last bit between processors, and the hash of a world must
not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from groundlink.core.fields import Vector3
from groundlink.core.frames import quaternion_from_rpy
from groundlink.world.solids import Box, Cylinder, Shape, Solid

from .indoor_specs import Cabinet, Chair, Door, Furniture, Pillar, Room, Shelf, Table

BOARD_M = 0.025
"""Thickness of table tops, boards, uprights and seats."""

LEG_M = 0.05
LEAF_M = 0.04
LEAF_GAP_M = 0.005
APRON_M = 3.0
"""How far the floor goes on beyond the walls, so that who leaves by the door does not fall."""

CHAIR_SIZE_M = (0.44, 0.44, 0.85)
SEAT_HEIGHT_M = 0.46

WALLS = {"north": (0.0, 1), "west": (90.0, 1), "south": (180.0, -1), "east": (-90.0, -1)}
"""Yaw (degrees) of the frame whose x runs along the wall and whose y points out of the room, and
whether that x has the direction of the world's axis along the wall."""


@dataclass(frozen=True)
class SupportSurface:
    """A level rectangle on which things can lie, in the world.

    Its centre, yaw, lengths along its own x and y, and the free height above it; metres, degrees.
    """

    center_m: Vector3
    yaw_deg: float
    length_m: float
    width_m: float
    clear_m: float


@dataclass(frozen=True)
class LocalFrame:
    """A place on the floor with a heading and a name, from which parts are put into the world."""

    name: str
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_deg: float = 0.0

    def point(self, x: float, y: float, z: float) -> Vector3:
        """Return in the world the point that stands at x, y, z in this frame."""
        c, s = _cos_sin(self.yaw_deg)
        return (
            _micrometres(self.x_m + c * x - s * y),
            _micrometres(self.y_m + s * x + c * y),
            _micrometres(self.z_m + z),
        )

    def put(
        self,
        part: str,
        shape: Shape,
        at: Vector3,
        material: str,
        *,
        roll_deg: float = 0.0,
        pitch_deg: float = 0.0,
        yaw_deg: float = 0.0,
    ) -> Solid:
        """Return a part as a solid in the world, named `<frame>_<part>`."""
        turn = quaternion_from_rpy(
            *map(math.radians, (roll_deg, pitch_deg, self.yaw_deg + yaw_deg))
        )
        x, y, z, w = (round(part, 9) + 0.0 for part in turn)
        return Solid(
            name=f"{self.name}_{part}",
            shape=shape,
            material=material,
            position_m=self.point(*at),
            orientation=(x, y, z, w),
        )

    def surface(
        self, at: Vector3, length_m: float, width_m: float, clear_m: float
    ) -> SupportSurface:
        """Return a surface around a point of this frame."""
        return SupportSurface(self.point(*at), self.yaw_deg, length_m, width_m, clear_m)


Furnished = tuple[list[Solid], list[SupportSurface]]


def build_room(room: Room) -> list[Solid]:
    """Return floor, ceiling, walls with the opening cut out, and the door's leaf."""
    length, width, height = room.size_m
    t = room.wall_thickness_m
    frame = LocalFrame("room")
    slab = (length + 2 * APRON_M, width + 2 * APRON_M, t)
    cover = (length + 2 * t, width + 2 * t, t)
    solids = [
        frame.put("floor", Box(size_m=slab), (0, 0, -t / 2), room.floor_material),
        frame.put("ceiling", Box(size_m=cover), (0, 0, height + t / 2), room.wall_material),
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
        solids += [
            wall.put(
                part,
                Box(size_m=(end - start, t, height - bottom)),
                ((start + end) / 2, (across + t) / 2, (bottom + height) / 2),
                room.wall_material,
            )
            for part, start, end, bottom in pieces
        ]
    return [*solids, _leaf(room, room.door)] if room.door else solids


def door_frame(room: Room, door: Door) -> LocalFrame:
    """Return the frame amid the opening at the wall's inner face: x along it, y out of the room."""
    yaw_deg, _ = WALLS[door.wall]
    along = LocalFrame("door", yaw_deg=yaw_deg)
    x, y, _ = along.point(sum(_span(door)) / 2, _lengths(room, door.wall)[1] / 2, 0)
    return LocalFrame("door", x, y, yaw_deg=yaw_deg)


def _leaf(room: Room, door: Door) -> Solid:
    """Return the leaf: hinged at the start of the opening, it swings into the room."""
    opening = door_frame(room, door)
    x, y, _ = opening.point(-door.width_m / 2, 0, 0)
    hinge = LocalFrame("door", x, y, yaw_deg=opening.yaw_deg - door.open_deg)
    size = (door.width_m - 2 * LEAF_GAP_M, LEAF_M, door.height_m - 2 * LEAF_GAP_M)
    # Its thickness lies in the opening when shut, and turns clear of the wall when open.
    side = -1 if 0 < door.open_deg <= 90 else 1
    at = (door.width_m / 2, side * LEAF_M / 2, door.height_m / 2)
    return hinge.put("leaf", Box(size_m=size), at, door.material)


def _lengths(room: Room, wall: str) -> tuple[float, float]:
    """Return the room's inner lengths along a wall and across it."""
    length, width, _ = room.size_m
    return (length, width) if wall in ("north", "south") else (width, length)


def _span(door: Door) -> tuple[float, float]:
    """Return where the opening starts and ends along the x of its wall's frame."""
    at = door.at_m * WALLS[door.wall][1]
    return at - door.width_m / 2, at + door.width_m / 2


def _legs(
    frame: LocalFrame, length: float, width: float, height: float, material: str
) -> list[Solid]:
    """Return four legs at the corners of a rectangle."""
    x, y = length / 2 - LEG_M / 2, width / 2 - LEG_M / 2
    return [
        frame.put(
            f"leg_{i}", Box(size_m=(LEG_M, LEG_M, height)), (sx * x, sy * y, height / 2), material
        )
        for i, (sx, sy) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1)))
    ]


def _table(frame: LocalFrame, table: Table) -> Furnished:
    length, width, height = table.size_m
    top = frame.put(
        "top", Box(size_m=(length, width, BOARD_M)), (0, 0, height - BOARD_M / 2), table.material
    )
    legs = _legs(frame, length, width, height - BOARD_M, table.material)
    return [top, *legs], [frame.surface((0, 0, height), length, width, 1.0)]


def _shelf(frame: LocalFrame, shelf: Shelf) -> Furnished:
    length, width, height = shelf.size_m
    inner = length - 2 * BOARD_M
    depth = width - BOARD_M
    solids = [
        frame.put(
            f"upright_{i}",
            Box(size_m=(BOARD_M, width, height)),
            (side * (length - BOARD_M) / 2, 0, height / 2),
            shelf.material,
        )
        for i, side in enumerate((1, -1))
    ]
    solids.append(
        frame.put(
            "back",
            Box(size_m=(inner, BOARD_M, height)),
            (0, (width - BOARD_M) / 2, height / 2),
            shelf.material,
        )
    )
    surfaces = []
    pitch = (height - BOARD_M) / (shelf.boards - 1)
    for i in range(shelf.boards):
        bottom = i * pitch
        at = (0.0, -BOARD_M / 2, bottom + BOARD_M / 2)
        solids.append(
            frame.put(f"board_{i}", Box(size_m=(inner, depth, BOARD_M)), at, shelf.material)
        )
        clear = pitch - BOARD_M if i < shelf.boards - 1 else 0.4
        surfaces.append(frame.surface((0, -BOARD_M / 2, bottom + BOARD_M), inner, depth, clear))
    return solids, surfaces


def _cabinet(frame: LocalFrame, cabinet: Cabinet) -> Furnished:
    body = frame.put(
        "body", Box(size_m=cabinet.size_m), (0, 0, cabinet.size_m[2] / 2), cabinet.material
    )
    return [body], []


def _chair(frame: LocalFrame, chair: Chair) -> Furnished:
    length, width, height = CHAIR_SIZE_M
    legs = _legs(frame, length, width, SEAT_HEIGHT_M - BOARD_M, chair.material)
    seat = frame.put(
        "seat",
        Box(size_m=(length, width, BOARD_M)),
        (0, 0, SEAT_HEIGHT_M - BOARD_M / 2),
        chair.material,
    )
    back = frame.put(
        "back",
        Box(size_m=(BOARD_M, width, height - SEAT_HEIGHT_M)),
        ((BOARD_M - length) / 2, 0, (height + SEAT_HEIGHT_M) / 2),
        chair.material,
    )
    return [*legs, seat, back], []


def _pillar(frame: LocalFrame, pillar: Pillar) -> Furnished:
    shape = Cylinder(radius_m=pillar.radius_m, length_m=pillar.height_m)
    return [frame.put("column", shape, (0, 0, pillar.height_m / 2), pillar.material)], []


KINDS: dict[type[Any], Callable[[LocalFrame, Any], Furnished]] = {
    Table: _table,
    Shelf: _shelf,
    Cabinet: _cabinet,
    Chair: _chair,
    Pillar: _pillar,
}
"""How each kind of furniture is made."""


def build_furniture(index: int, furniture: Furniture) -> Furnished:
    """Return the solids of one piece of furniture, and the surfaces that it offers to clutter."""
    kind = type(furniture)
    frame = LocalFrame(
        f"{kind.__struct_config__.tag}_{index}",
        *furniture.at_m,
        yaw_deg=getattr(furniture, "yaw_deg", 0.0),
    )
    return KINDS[kind](frame, furniture)


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))


def _micrometres(value: float) -> float:
    return float(round(value, 6)) + 0.0  # + 0.0 makes -0.0 a plain zero, which hashes alike
