# SPDX-License-Identifier: Apache-2.0
"""Distances of points to the surfaces of a world.

Exact for boxes, cylinders and spheres. Shares no code with the ray caster, which it checks.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import matrix_from_quaternion
from groundlink.world.solids import Box, Cylinder, Solid, Sphere

Floats = NDArray[np.float64]


def distances_m(points_m: Floats, solids: Sequence[Solid]) -> Floats:
    """Return the distance of each point to the nearest surface, shape (N,).

    Parameters
    ----------
    points_m
        shape (N, 3), in the world.

    Raises
    ------
    TypeError
        for a shape of triangles, whose distances are not simple.
    """
    nearest = np.full(len(points_m), np.inf)
    for solid in solids:
        rotation = matrix_from_quaternion(solid.orientation)
        local = (points_m - solid.position_m) @ rotation
        np.minimum(nearest, np.abs(_signed_m(local, solid)), out=nearest)
    return nearest


def _signed_m(local: Floats, solid: Solid) -> Floats:
    """Return distances to a solid about the origin, negative inside."""
    shape = solid.shape
    if isinstance(shape, Box):
        return _corner_m(np.abs(local) - np.array(shape.size_m) / 2)
    if isinstance(shape, Cylinder):
        aside = np.hypot(local[:, 0], local[:, 1]) - shape.radius_m
        return _corner_m(np.stack([aside, np.abs(local[:, 2]) - shape.length_m / 2], axis=1))
    if isinstance(shape, Sphere):
        ball: Floats = np.linalg.norm(local, axis=1) - shape.radius_m
        return ball
    raise TypeError(f"{solid.name}: no distance to a {type(shape).__name__}")


def _corner_m(beyond: Floats) -> Floats:
    """Return distances by how far points are beyond each face, shape (N, faces)."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    signed: Floats = outside + np.minimum(beyond.max(axis=1), 0.0)
    return signed
