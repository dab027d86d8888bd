# SPDX-License-Identifier: Apache-2.0
"""Clutter: boxes and cans at random places on surfaces, without overlaps.

A random place where the object would overlap or stick out is drawn again.
"""

import numpy as np

from groundlink.world.bounds import Bounds, bounds, overlap
from groundlink.world.solids import Box, Cylinder, Solid

from .indoor_specs import Clutter
from .local_frame import LocalFrame, SupportSurface

TRIES = 400
"""Tries for one object before the room counts as full."""

RIM_M = 0.01
"""Free margin at the rim of a surface, and below the next board."""


class NoFreePlace(ValueError):
    """There is no free place left for the clutter."""


def place_clutter(
    clutter: Clutter,
    surfaces: list[SupportSurface],
    occupied: list[Bounds],
    generator: np.random.Generator,
) -> list[Solid]:
    """Return the clutter.

    Parameters
    ----------
    clutter
        count, sizes and materials.
    surfaces
        candidate surfaces, all equally likely.
    occupied
        occupied boxes in the world.
    generator
        source of randomness.

    Raises
    ------
    NoFreePlace
        when no free place is left.
    """
    solids: list[Solid] = []
    lows = np.zeros((len(occupied) + clutter.count, 3))
    highs = np.zeros_like(lows)
    for row, (low, high) in enumerate(occupied):
        lows[row], highs[row] = low, high
    for index in range(clutter.count):
        row = len(occupied) + index
        for _ in range(TRIES):
            solid = _throw(index, clutter, surfaces, generator) if surfaces else None
            if solid and not overlap(bounds(solid), (lows[:row], highs[:row])):
                break
        else:
            raise NoFreePlace(f"only {index} of {clutter.count} pieces found a free place")
        solids.append(solid)
        lows[row], highs[row] = bounds(solid)
    return solids


def _throw(
    index: int, clutter: Clutter, surfaces: list[SupportSurface], generator: np.random.Generator
) -> Solid | None:
    """Return an object at a random place, or None if it would stick out."""
    surface = surfaces[generator.integers(len(surfaces))]
    material = clutter.materials[generator.integers(len(clutter.materials))]
    lengths = np.round(generator.uniform(*clutter.size_m, 3), 3).tolist()
    yaw_deg = round(float(generator.uniform(-180, 180)), 1)
    along, across = generator.uniform(-0.5, 0.5, 2)
    shape: Box | Cylinder = Box(size_m=tuple(lengths))
    if generator.random() < 0.3:
        # Cans are at most as wide as they are high.
        shape = Cylinder(radius_m=min(lengths[0], lengths[2]) / 2, length_m=lengths[2])
    thing = LocalFrame("clutter").put(str(index), shape, (0, 0, 0), material, yaw_deg=yaw_deg)
    half_x, half_y, half_z = bounds(thing)[1]
    free_x, free_y = (
        length - 2 * (half + RIM_M)
        for length, half in ((surface.length_m, half_x), (surface.width_m, half_y))
    )
    if min(free_x, free_y) < 0 or 2 * half_z > surface.clear_m - RIM_M:
        return None
    place = LocalFrame("clutter", *surface.center_m, yaw_deg=surface.yaw_deg)
    return place.put(
        str(index), shape, (along * free_x, across * free_y, half_z), material, yaw_deg=yaw_deg
    )
