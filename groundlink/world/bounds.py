# SPDX-License-Identifier: Apache-2.0
"""Axis-aligned bounding boxes of solids, and overlap tests.

Bounds are conservative: cylinders, spheres and meshes count as their bounding boxes.
"""

import numpy as np

from groundlink.core.frames import Floats, matrix_from_quaternion

from .solids import Box, Cylinder, Mesh, Shape, Solid

Bounds = tuple[Floats, Floats]
"""Lowest and highest corner, each of shape (3,), meters."""

_YZX, _ZXY = [1, 2, 0], [2, 0, 1]
"""Axes in the two orders that the components of a cross product have them in."""


def half_extents(shape: Shape) -> Floats:
    """Return half the lengths along the shape's own axes, shape (3,), meters."""
    if isinstance(shape, Box):
        return np.array(shape.size_m) / 2
    if isinstance(shape, Cylinder):
        return np.array([shape.radius_m, shape.radius_m, shape.length_m / 2])
    if isinstance(shape, Mesh):
        return (np.array(shape.high_m) - shape.low_m) / 2
    return np.full(3, shape.radius_m)


def middle(solid: Solid) -> Floats:
    """Return the middle of a solid in the frame it is placed in, shape (3,), meters."""
    position = np.array(solid.position_m)
    if isinstance(solid.shape, Mesh):
        in_solid = (np.array(solid.shape.high_m) + solid.shape.low_m) / 2
        return position + matrix_from_quaternion(solid.orientation) @ in_solid
    return position


def bounds(solid: Solid) -> Bounds:
    """Return the corners of the box around a solid along the axes of the frame it is placed in."""
    center = middle(solid)
    half = np.abs(matrix_from_quaternion(solid.orientation)) @ half_extents(solid.shape)
    return center - half, center + half


def overlap(box: Bounds, others: Bounds, *, touch_m: float = 1e-6) -> bool:
    """Return whether a box shares more than `touch_m` along every axis with any of others.

    The corners of `others` have shape (..., 3).
    """
    shared = np.minimum(box[1], others[1]) - np.maximum(box[0], others[0])
    return bool(np.any(np.all(shared > touch_m, axis=-1)))


def intersect(first: Solid, second: Solid) -> bool:
    """Return whether two solids overlap; exact for boxes of any orientation.

    Separating axis theorem: boxes are apart if their projections on one of 15 axes (edges, and
    cross products of edges) are.
    """
    a, b = (matrix_from_quaternion(solid.orientation) for solid in (first, second))
    # `np.cross` has the same bits and takes twice as long.
    across = a.T[:, None, _YZX] * b.T[None, :, _ZXY] - a.T[:, None, _ZXY] * b.T[None, :, _YZX]
    axes = np.vstack([a.T, b.T, across.reshape(9, 3)])
    reach = np.abs(axes @ a) @ half_extents(first.shape)
    reach += np.abs(axes @ b) @ half_extents(second.shape)
    apart = np.abs(axes @ (middle(second) - middle(first)))
    # Parallel edges have a zero cross product, which separates nothing.
    return bool(np.all((apart < reach) | (np.linalg.norm(axes, axis=1) < 1e-9)))
