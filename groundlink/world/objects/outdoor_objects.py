# SPDX-License-Identifier: Apache-2.0
"""Houses, trees, fences and other outdoor objects as boxes, cylinders and spheres.

Each kind is one function that yields its parts around its own origin on the ground, as few as make
it recognizable: physics and LiDARs handle each solid on its own. Objects on a slope extend into the
ground, so that nothing floats.
"""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise, product
from typing import Any

from groundlink.core.fields import Vector3
from groundlink.world.solids import Solid

from . import outdoor_specs as specs
from .local_frame import LocalFrame, cos_sin

FOOTING_M = 0.35
"""Height of a house's footing above the ground, and its depth below."""

EAVES_M = 0.5
"""Horizontal overhang of a roof."""

ROOF_M = 0.16
INSET_M = 0.02
"""Distance of the gables behind the walls, so that no two faces coincide."""

WINDOW_M = (1.0, 1.3)
WINDOW_EVERY_M = 2.4
STOREY_M = 2.8
SILL_M = 0.9

BURIED_M = 0.3
"""Depth of trunks and posts in the ground."""

ON_A_CORNER = [
    {"roll_deg": 45.0, "pitch_deg": math.degrees(math.atan(math.sqrt(1 / 2))), "yaw_deg": yaw_deg}
    for yaw_deg in (0.0, 60.0)
]
"""Rotations of cubes that stand on a corner; two of them look like a star from above."""

CROWNS: dict[str, tuple[float, float, list[tuple[float, float, float, float]]]] = {
    "oak": (
        *(0.55, 0.03),
        [
            (0.0, 0.0, 0.68, 0.25),
            (0.20, 0.05, 0.58, 0.18),
            (-0.14, 0.17, 0.60, 0.19),
            (-0.08, -0.20, 0.57, 0.17),
            (0.05, 0.03, 0.82, 0.18),
        ],
    ),
    "birch": (
        *(0.70, 0.014),
        [
            (0.02, 0.01, 0.50, 0.13),
            (-0.05, 0.04, 0.62, 0.14),
            (0.05, -0.03, 0.73, 0.13),
            (-0.01, 0.01, 0.85, 0.11),
            (0.0, 0.0, 0.945, 0.055),
        ],
    ),
    "spruce": (0.20, 0.022, [(0.0, 0.0, 0.27 + 0.105 * i, 0.22 - 0.023 * i) for i in range(7)]),
}
"""Height and radius of the trunk, then x, y, z and radius of each part of the crown, in
multiples of the height. Parts are spheres; those of a spruce are cubes on a corner."""

BUSH = ((0.0, 0.0, 0.5, 0.5), (0.42, 0.12, 0.32, 0.38), (-0.30, 0.30, 0.28, 0.36))
"""x, y, z and radius of each sphere, in multiples of the height."""

ROCK = (((1.5, 1.1, 0.8), (0.0, 12.0, 9.0)), ((1.0, 1.2, 1.0), (40.0, -14.0, 17.0)))
"""Size of each block in multiples of the height, and its yaw, roll and pitch in degrees."""


def build_outdoor_object(index: int, thing: specs.OutdoorObject) -> list[Solid]:
    """Return the solids of an outdoor object, named `<kind>_<index>_<part>`."""
    name = f"{thing.__struct_config__.tag}_{index}"
    if isinstance(thing, specs.Fence):
        return list(_fence(name, thing))
    frame = LocalFrame(name, *thing.at_m, thing.z_m or 0.0, thing.yaw_deg)
    return list(BUILDERS[type(thing)](frame, thing))


def _house(frame: LocalFrame, house: specs.House) -> Iterator[Solid]:
    length, width, eaves = house.size_m
    footing = (length + 0.2, width + 0.2, 2 * FOOTING_M)
    yield frame.box("footing", footing, (0, 0, 0), house.footing_material)
    yield frame.box("walls", house.size_m, (0, 0, eaves / 2), house.wall_material)
    yield from _roof(frame, house)
    door_width, door_height = house.door_m
    rise = FOOTING_M if house.windows else 0.0
    for part, margin, out, material in (
        ("door_frame", 0.1, 0.15, house.frame_material),
        ("door", 0.0, 0.18, house.door_material),
    ):
        size = (door_width + 2 * margin, 2 * out, door_height + margin)
        at = (0.0, -width / 2, rise + (door_height + margin) / 2)
        yield frame.box(part, size, at, material)
    if house.windows:
        for i in range(2):
            step = (door_width + 0.4, 0.35, FOOTING_M * (2 - i) / 2)
            at = (0.0, -width / 2 - 0.275 - 0.35 * i, FOOTING_M * (2 - i) / 4)
            yield frame.box(f"step_{i}", step, at, house.footing_material)
        yield from _windows(frame, house)


def _roof(frame: LocalFrame, house: specs.House) -> Iterator[Solid]:
    """Yield two slabs, and below each a beam as thick as the attic, which forms half of the gables.

    Up to 45 degrees the beams stay within slabs and walls.
    """
    length, width, eaves = house.size_m
    c, s = cos_sin(house.roof_deg)
    slope_m = width / 2 / c
    attic = (length - 2 * INSET_M, slope_m, width / 2 * s)
    below_m, above_m = EAVES_M / c, ROOF_M * s / c
    slab = (length + 2 * EAVES_M, slope_m + below_m + above_m, ROOF_M)
    for part, side in (("front", -1.0), ("back", 1.0)):
        # Middle of the slope; unit vectors along it towards the eaves, and out of it.
        middle = side * width / 4, eaves + width / 4 * s / c
        along, out = (side * c, -s), (side * s, c)
        for name, size, down_m, out_m, material in (
            ("attic", attic, 0.0, -attic[2] / 2, house.wall_material),
            # Extended above the ridge to meet the upper face of the other slab.
            ("roof", slab, (below_m - above_m) / 2, ROOF_M / 2, house.roof_material),
        ):
            y, z = (middle[i] + along[i] * down_m + out[i] * out_m for i in (0, 1))
            roll_deg = -side * house.roof_deg
            yield frame.box(f"{name}_{part}", size, (0.0, y, z), material, roll_deg=roll_deg)
    if house.chimney:
        top = eaves + width / 2 * s / c + 0.7
        at = (0.25 * length, 0.12 * width, (top + eaves) / 2)
        yield frame.box("chimney", (0.6, 0.6, top - eaves), at, house.chimney_material)


def _windows(frame: LocalFrame, house: specs.House) -> Iterator[Solid]:
    """Yield rows of windows (frame, pane, bar) along all four walls, except at the door."""
    length, width, eaves = house.size_m
    wide, high = WINDOW_M
    for wall in range(4):
        along, across = (width, length) if wall % 2 else (length, width)
        facade = LocalFrame(frame.name, *frame.point(0, 0, 0), frame.yaw_deg + 90.0 * wall)
        count = max(1, int((along - 0.6) / WINDOW_EVERY_M))
        for storey, i in product(range(max(1, round(eaves / STOREY_M))), range(count)):
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
                yield facade.box(name, (w, 2 * out, h), (x, -across / 2, z), material)


def _tree(frame: LocalFrame, tree: specs.Tree) -> Iterator[Solid]:
    height = tree.height_m
    bare, thick, crown = CROWNS[tree.species]
    at = (0.0, 0.0, (bare * height - BURIED_M) / 2)
    yield frame.cylinder("trunk", thick * height, bare * height + BURIED_M, at, tree.bark_material)
    if tree.species != "spruce":
        yield from frame.balls("crown", height, crown, tree.leaf_material)
        return
    for i, (x, y, z, radius) in enumerate(crown):
        side, at = radius * height * math.sqrt(3 / 2), (x * height, y * height, z * height)
        cube = (side, side, side)
        yield frame.box(f"crown_{i}", cube, at, tree.leaf_material, **ON_A_CORNER[i % 2])


def _bush(frame: LocalFrame, bush: specs.Bush) -> Iterator[Solid]:
    return frame.balls("ball", bush.height_m, BUSH, bush.leaf_material)


def _rock(frame: LocalFrame, rock: specs.Rock) -> Iterator[Solid]:
    height = rock.height_m
    for i, ((long, wide, high), (yaw, roll, pitch)) in enumerate(ROCK):
        size = (long * height, wide * height, high * height)
        at = (0.1 * i * height, 0.0, (0.25 + 0.1 * i) * height)
        turn = {"yaw_deg": yaw, "roll_deg": roll, "pitch_deg": pitch}
        yield frame.box(f"block_{i}", size, at, rock.material, **turn)


def _pole(frame: LocalFrame, pole: specs.Pole) -> Iterator[Solid]:
    yield _post(frame, "post", 0.12, pole.height_m, pole.material)
    z = pole.height_m - 0.6
    yield frame.box("arm", (0.1, 1.8, 0.12), (0.12, 0, z), pole.material)
    for i, y in enumerate((-0.8, -0.35, 0.35, 0.8)):
        at = (0.12, y, z + 0.14)
        yield frame.cylinder(f"insulator_{i}", 0.05, 0.16, at, pole.insulator_material)


def _lamp(frame: LocalFrame, lamp: specs.Lamp) -> Iterator[Solid]:
    height = lamp.height_m
    yield _post(frame, "foot", 0.11, 0.8, lamp.material)
    yield _post(frame, "post", 0.06, height, lamp.material)
    yield frame.box("arm", (1.2, 0.07, 0.07), (0.55, 0, height - 0.04), lamp.material)
    yield frame.box("head", (0.6, 0.26, 0.1), (1.2, 0, height), lamp.material)
    yield frame.box("glass", (0.5, 0.2, 0.05), (1.2, 0, height - 0.07), lamp.glass_material)


def _post(frame: LocalFrame, part: str, radius_m: float, height_m: float, material: str) -> Solid:
    """Return a round post that extends into the ground."""
    at = (0, 0, (height_m - BURIED_M) / 2)
    return frame.cylinder(part, radius_m, height_m + BURIED_M, at, material)


def _bale(frame: LocalFrame, bale: specs.Bale) -> Iterator[Solid]:
    at = (0, 0, bale.radius_m)
    yield frame.cylinder("roll", bale.radius_m, bale.length_m, at, bale.material, roll_deg=90.0)


def _crate(frame: LocalFrame, crate: specs.Crate) -> Iterator[Solid]:
    length, width, height = crate.size_m
    yield frame.box("body", crate.size_m, (0, 0, height / 2), crate.material)
    for i, x in enumerate((-0.36, 0.36)):
        size = (0.1 * length, width + 0.05, height + 0.03)
        yield frame.box(f"batten_{i}", size, (x * length, 0.0, size[2] / 2), crate.material)


def _fence(name: str, fence: specs.Fence) -> Iterator[Solid]:
    feet = fence.feet()
    heights = fence.ground_m or [0.0] * len(feet)
    posts: list[Vector3] = [(*foot, z) for foot, z in zip(feet, heights, strict=True)]
    bays = list(pairwise(posts))
    yaws = [math.degrees(math.atan2(y1 - y0, x1 - x0)) for (x0, y0, _), (x1, y1, _) in bays]
    post = (specs.POST_M, specs.POST_M, fence.height_m + BURIED_M)
    at = (0.0, 0.0, (fence.height_m - BURIED_M) / 2)
    for i, (x, y, z) in enumerate(posts):
        yaw_deg = yaws[min(i, len(bays) - 1)]
        yield LocalFrame(name, x, y, z, yaw_deg).box(f"post_{i}", post, at, fence.material)
    for i, ((x0, y0, z0), (x1, y1, z1)) in enumerate(bays):
        across = math.hypot(x1 - x0, y1 - y0)
        length = math.hypot(across, z1 - z0)
        bay = LocalFrame(name, (x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2, yaws[i])
        # The axis of a cylinder is z: pitch it to x, and along the slope of the ground.
        pitch_deg = 90.0 - math.degrees(math.atan2(z1 - z0, across))
        for j in range(fence.rails):
            at = (0.0, 0.0, (j + 1) / fence.rails * (fence.height_m - 0.12))
            rail = f"rail_{i}_{j}"
            yield bay.cylinder(rail, 0.045, length, at, fence.material, pitch_deg=pitch_deg)


BUILDERS: dict[type[specs.PlacedObject], Callable[[LocalFrame, Any], Iterator[Solid]]] = {
    specs.House: _house,
    specs.Tree: _tree,
    specs.Bush: _bush,
    specs.Rock: _rock,
    specs.Pole: _pole,
    specs.Lamp: _lamp,
    specs.Bale: _bale,
    specs.Crate: _crate,
}
"""Builder of each kind of object at one place."""
