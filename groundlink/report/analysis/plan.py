# SPDX-License-Identifier: Apache-2.0
"""Plan of the world: outlines of obstacles from above.

Floors, ceilings and objects above a vehicle's reach are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.world.bounds import bounds, middle
from groundlink.world.solids import Box, Mesh, Solid
from groundlink.world.triangles import merged

FLAT_M = 0.02
"""Lower solids count as floor."""

OVERHEAD_M = 1.5
"""Solids above do not obstruct vehicles."""


@dataclass(frozen=True)
class SolidOutline:
    """One solid from above."""

    name: str
    corners_m: NDArray[np.float64]
    """Shape (N, 2): its convex outline, counterclockwise."""

    low_m: float
    high_m: float


def outlines(solids: Sequence[Solid], *, level: bool = True) -> list[SolidOutline]:
    """Return the outlines of obstacles, the lowest first.

    On terrain all solids are returned, since their height above ground is unknown.
    """
    found = []
    for solid in solids:
        low, high = bounds(solid)
        if level and (high[2] <= FLAT_M or low[2] >= OVERHEAD_M):
            continue
        corners = _hull(_footprint(solid))
        found.append(SolidOutline(solid.name, corners, float(low[2]), float(high[2])))
    return sorted(found, key=lambda outline: outline.high_m)


def _footprint(solid: Solid) -> NDArray[np.float64]:
    """Return points whose hull is the outline of a solid from above.

    Meshes count as boxes, since a recording holds no mesh assets.
    """
    if isinstance(solid.shape, Mesh):
        size = np.subtract(solid.shape.high_m, solid.shape.low_m)
        solid = replace(
            solid,
            shape=Box(size_m=tuple(np.maximum(size, 1e-3).tolist())),
            position_m=tuple(middle(solid).tolist()),
        )
    return merged([solid]).vertices[:, :2].astype(np.float64)


def _hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the convex hull of points, counterclockwise (Andrew's monotone chain)."""
    ordered = sorted(set(map(tuple, np.round(points, 6).tolist())))
    chains = []
    for sequence in (ordered, ordered[::-1]):
        chain: list[tuple[float, ...]] = []
        for x, y in sequence:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], (x, y)) <= 0:
                chain.pop()
            chain.append((x, y))
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _turn(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    """Return twice the area of a triangle, positive where it turns to the left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
