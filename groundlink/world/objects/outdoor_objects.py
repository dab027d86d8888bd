# SPDX-License-Identifier: Apache-2.0
"""Houses, trees and fences as boxes, cylinders and balls.

Rule: as of `furnish`, one function a kind, around its own origin on the ground, and no more solids
than are needed to tell what it is: physics and LiDARs take each one as it is. What stands on a
slope goes on into the ground, so that nothing floats.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

from groundlink.core.fields import Vector3
from groundlink.world.solids import Box, Cylinder, Solid, Sphere

from .indoor_objects import LocalFrame
from .outdoor_specs import (
    POST_M,
    Bale,
    Bush,
    Crate,
    Fence,
    House,
    Lamp,
    OutdoorObject,
    PlacedObject,
    Pole,
    Rock,
    Tree,
)

FOOTING_M = 0.35
"""How high a house's footing shows, and how deep it goes."""

EAVES_M = 0.5
"""How far a roof goes beyond walls, level."""

ROOF_M = 0.16
INSET_M = 0.02
"""How far the attic's gable stands behind the walls, so that no two faces are one."""

WINDOW_M = (1.0, 1.3)
WINDOW_EVERY_M = 2.4
STOREY_M = 2.8
SILL_M = 0.9

BURIED_M = 0.3
"""How deep trunks, posts and rocks go into the ground."""


def build_outdoor_object(index: int, thing: OutdoorObject) -> list[Solid]:
    """Return the solids of one thing, named `<kind>_<index>_<part>`."""
    name = f"{thing.__struct_config__.tag}_{index}"
    if isinstance(thing, Fence):
        return list(_fence(name, thing))
    return list(
        KINDS[type(thing)](LocalFrame(name, *thing.at_m, thing.z_m or 0.0, thing.yaw_deg), thing)
    )


def _house(frame: LocalFrame, house: House) -> Iterator[Solid]:
    length, width, eaves = house.size_m
    foot = Box(size_m=(length + 0.2, width + 0.2, 2 * FOOTING_M))
    yield frame.put("footing", foot, (0, 0, 0), house.footing_material)
    yield frame.put("walls", Box(size_m=house.size_m), (0, 0, eaves / 2), house.wall_material)
    yield from _roof(frame, house)
    door_width, door_height = house.door_m
    rise = FOOTING_M if house.windows else 0.0
    for part, margin, out, material in (
        ("door_frame", 0.1, 0.15, house.frame_material),
        ("door", 0.0, 0.18, house.door_material),
    ):
        shape = Box(size_m=(door_width + 2 * margin, 2 * out, door_height + margin))
        at = (0.0, -width / 2, rise + (door_height + margin) / 2)
        yield frame.put(part, shape, at, material)
    if house.windows:
        for i in range(2):
            step = Box(size_m=(door_width + 0.4, 0.35, FOOTING_M * (2 - i) / 2))
            at = (0.0, -width / 2 - 0.275 - 0.35 * i, FOOTING_M * (2 - i) / 4)
            yield frame.put(f"step_{i}", step, at, house.footing_material)
        yield from _windows(frame, house)


def _roof(frame: LocalFrame, house: House) -> Iterator[Solid]:
    """Yield two slabs, and below each a beam as thick as the attic: its half of the gables.

    Beams stay within the slabs and the walls up to 45 degrees.
    """
    length, width, eaves = house.size_m
    c, s = _cos_sin(house.roof_deg)
    slope_m = width / 2 / c
    attic = Box(size_m=(length - 2 * INSET_M, slope_m, width / 2 * s))
    below_m, above_m = EAVES_M / c, ROOF_M * s / c
    slab = Box(size_m=(length + 2 * EAVES_M, slope_m + below_m + above_m, ROOF_M))
    for part, side in (("front", -1.0), ("back", 1.0)):
        roll_deg = -side * house.roof_deg
        # From the middle of the slope: along it towards the eaves, and out of it.
        middle = side * width / 4, eaves + width / 4 * s / c
        along, out = (side * c, -s), (side * s, c)
        for name, shape, down_m, out_m, material in (
            ("attic", attic, 0.0, -attic.size_m[2] / 2, house.wall_material),
            # Above the ridge as far as it takes to meet the other slab's upper face.
            ("roof", slab, (below_m - above_m) / 2, ROOF_M / 2, house.roof_material),
        ):
            y, z = (middle[i] + along[i] * down_m + out[i] * out_m for i in (0, 1))
            yield frame.put(f"{name}_{part}", shape, (0.0, y, z), material, roll_deg=roll_deg)
    if house.chimney:
        top = eaves + width / 2 * s / c + 0.7
        shape = Box(size_m=(0.6, 0.6, top - eaves))
        at = (0.25 * length, 0.12 * width, (top + eaves) / 2)
        yield frame.put("chimney", shape, at, house.chimney_material)


def _windows(frame: LocalFrame, house: House) -> Iterator[Solid]:
    """Yield frames, panes and a bar in each, in rows along all four walls, off the door."""
    length, width, eaves = house.size_m
    wide, high = WINDOW_M
    for wall, (along, across, yaw_deg) in enumerate(
        (
            (length, width, 0.0),
            (width, length, 90.0),
            (length, width, 180.0),
            (width, length, 270.0),
        )
    ):
        facade = LocalFrame(frame.name, *frame.point(0, 0, 0), frame.yaw_deg + yaw_deg)
        count = max(1, int((along - 0.6) / WINDOW_EVERY_M))
        for storey in range(max(1, round(eaves / STOREY_M))):
            for i in range(count):
                x = along * ((i + 0.5) / count - 0.5)
                if wall == 0 and storey == 0 and abs(x) < (wide + house.door_m[0]) / 2 + 0.3:
                    continue
                z = FOOTING_M + SILL_M + high / 2 + storey * STOREY_M
                for part, (w, h, out), material in (
                    ("frame", (wide + 0.16, high + 0.16, 0.03), house.frame_material),
                    ("pane", (wide, high, 0.04), house.glass_material),
                    ("bar", (0.06, high, 0.05), house.frame_material),
                ):
                    name = f"window_{wall}_{storey}_{i}_{part}"
                    shape = Box(size_m=(w, 2 * out, h))
                    yield facade.put(name, shape, (x, -across / 2, z), material)


def _tree(frame: LocalFrame, tree: Tree) -> Iterator[Solid]:
    height = tree.height_m
    bare, thick, crown = CROWNS[tree.species]
    trunk = Cylinder(radius_m=thick * height, length_m=bare * height + BURIED_M)
    at = (0.0, 0.0, (bare * height - BURIED_M) / 2)
    yield frame.put("trunk", trunk, at, tree.bark_material)
    for i, (x, y, z, radius) in enumerate(crown):
        place = (x * height, y * height, z * height)
        if tree.species == "spruce":
            cube = Box(size_m=(radius * height * math.sqrt(3 / 2),) * 3)
            yield frame.put(f"crown_{i}", cube, place, tree.leaf_material, **ON_A_CORNER[i % 2])
        else:
            ball = Sphere(radius_m=radius * height)
            yield frame.put(f"crown_{i}", ball, place, tree.leaf_material)


ON_A_CORNER = [
    {"roll_deg": 45.0, "pitch_deg": math.degrees(math.atan(math.sqrt(1 / 2))), "yaw_deg": yaw_deg}
    for yaw_deg in (0.0, 60.0)
]
"""How cubes are turned that stand on a corner: two on each other are six-pointed from above."""

CROWNS: dict[str, tuple[float, float, list[tuple[float, float, float, float]]]] = {
    "oak": (
        0.55,
        0.03,
        [
            (0.0, 0.0, 0.68, 0.25),
            (0.20, 0.05, 0.58, 0.18),
            (-0.14, 0.17, 0.60, 0.19),
            (-0.08, -0.20, 0.57, 0.17),
            (0.05, 0.03, 0.82, 0.18),
        ],
    ),
    "birch": (
        0.70,
        0.014,
        [
            (0.02, 0.01, 0.50, 0.13),
            (-0.05, 0.04, 0.62, 0.14),
            (0.05, -0.03, 0.73, 0.13),
            (-0.01, 0.01, 0.85, 0.11),
            (0.0, 0.0, 0.945, 0.055),
        ],
    ),
    "spruce": (
        0.20,
        0.022,
        [(0.0, 0.0, 0.27 + 0.105 * i, 0.22 - 0.023 * i) for i in range(7)],
    ),
}
"""Of each species: height and radius of the trunk, places and radii of the crown's parts: balls, or
cubes of a spruce's. All in multiples of the tree's height."""


def _bush(frame: LocalFrame, bush: Bush) -> Iterator[Solid]:
    height = bush.height_m
    for i, (x, y, z, radius) in enumerate(
        ((0.0, 0.0, 0.5, 0.5), (0.42, 0.12, 0.32, 0.38), (-0.30, 0.30, 0.28, 0.36))
    ):
        place = (x * height, y * height, z * height)
        shape = Sphere(radius_m=radius * height)
        yield frame.put(f"ball_{i}", shape, place, bush.leaf_material)


def _rock(frame: LocalFrame, rock: Rock) -> Iterator[Solid]:
    height = rock.height_m
    for i, (long, wide, high, turn) in enumerate(
        ((1.5, 1.1, 0.8, (0.0, 12.0, 9.0)), (1.0, 1.2, 1.0, (40.0, -14.0, 17.0)))
    ):
        shape = Box(size_m=(long * height, wide * height, high * height))
        yaw_deg, roll_deg, pitch_deg = turn
        at = (0.1 * i * height, 0.0, (0.25 + 0.1 * i) * height)
        part = f"block_{i}"
        yield frame.put(
            part, shape, at, rock.material, yaw_deg=yaw_deg, roll_deg=roll_deg, pitch_deg=pitch_deg
        )


def _pole(frame: LocalFrame, pole: Pole) -> Iterator[Solid]:
    yield _post(frame, "post", 0.12, pole.height_m, pole.material)
    z = pole.height_m - 0.6
    yield frame.put("arm", Box(size_m=(0.1, 1.8, 0.12)), (0.12, 0, z), pole.material)
    insulator = Cylinder(radius_m=0.05, length_m=0.16)
    for i, y in enumerate((-0.8, -0.35, 0.35, 0.8)):
        yield frame.put(f"insulator_{i}", insulator, (0.12, y, z + 0.14), pole.insulator_material)


def _lamp(frame: LocalFrame, lamp: Lamp) -> Iterator[Solid]:
    height = lamp.height_m
    yield _post(frame, "foot", 0.11, 0.8, lamp.material)
    yield _post(frame, "post", 0.06, height, lamp.material)
    yield frame.put("arm", Box(size_m=(1.2, 0.07, 0.07)), (0.55, 0, height - 0.04), lamp.material)
    yield frame.put("head", Box(size_m=(0.6, 0.26, 0.1)), (1.2, 0, height), lamp.material)
    at = (1.2, 0, height - 0.07)
    yield frame.put("glass", Box(size_m=(0.5, 0.2, 0.05)), at, lamp.glass_material)


def _post(frame: LocalFrame, part: str, radius_m: float, height_m: float, material: str) -> Solid:
    """Return a round post that goes on into the ground."""
    shape = Cylinder(radius_m=radius_m, length_m=height_m + BURIED_M)
    return frame.put(part, shape, (0, 0, (height_m - BURIED_M) / 2), material)


def _bale(frame: LocalFrame, bale: Bale) -> Iterator[Solid]:
    shape = Cylinder(radius_m=bale.radius_m, length_m=bale.length_m)
    yield frame.put("roll", shape, (0, 0, bale.radius_m), bale.material, roll_deg=90.0)


def _crate(frame: LocalFrame, crate: Crate) -> Iterator[Solid]:
    length, width, height = crate.size_m
    yield frame.put("body", Box(size_m=crate.size_m), (0, 0, height / 2), crate.material)
    for i, x in enumerate((-0.36, 0.36)):
        batten = Box(size_m=(0.1 * length, width + 0.05, height + 0.03))
        at = (x * length, 0.0, batten.size_m[2] / 2)
        yield frame.put(f"batten_{i}", batten, at, crate.material)


def _fence(name: str, fence: Fence) -> Iterator[Solid]:
    feet = fence.feet()
    heights = fence.ground_m or [0.0] * len(feet)
    posts: list[Vector3] = [(*foot, z) for foot, z in zip(feet, heights, strict=True)]
    shape = Box(size_m=(POST_M, POST_M, fence.height_m + BURIED_M))
    bays = list(pairwise(posts))
    for i, (x, y, z) in enumerate(posts):
        (x0, y0, _), (x1, y1, _) = bays[min(i, len(bays) - 1)]
        yaw_deg = math.degrees(math.atan2(y1 - y0, x1 - x0))
        at = (0.0, 0.0, (fence.height_m - BURIED_M) / 2)
        yield LocalFrame(name, x, y, z, yaw_deg).put(f"post_{i}", shape, at, fence.material)
    for i, ((x0, y0, z0), (x1, y1, z1)) in enumerate(bays):
        across = math.hypot(x1 - x0, y1 - y0)
        yaw_deg = math.degrees(math.atan2(y1 - y0, x1 - x0))
        bay = LocalFrame(name, (x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2, yaw_deg)
        # A cylinder's axis is along z: it is laid along x, and down with the ground.
        pitch_deg = 90.0 - math.degrees(math.atan2(z1 - z0, across))
        rail = Cylinder(radius_m=0.045, length_m=math.hypot(across, z1 - z0))
        for j in range(fence.rails):
            at = (0.0, 0.0, (j + 1) / fence.rails * (fence.height_m - 0.12))
            yield bay.put(f"rail_{i}_{j}", rail, at, fence.material, pitch_deg=pitch_deg)


KINDS: dict[type[PlacedObject], Callable[[LocalFrame, Any], Iterator[Solid]]] = {
    House: _house,
    Tree: _tree,
    Bush: _bush,
    Rock: _rock,
    Pole: _pole,
    Lamp: _lamp,
    Bale: _bale,
    Crate: _crate,
}
"""How each kind of thing that stands at one place is made."""


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
