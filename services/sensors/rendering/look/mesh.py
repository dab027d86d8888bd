# SPDX-License-Identifier: Apache-2.0
"""Triangles with normals, colors, textures and labels.

A mesh is what a renderer draws. `shapes` makes meshes of solids, `painted` of meshes with colors of
their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

VERTEX = np.dtype(
    [
        ("position", np.float32, 3),
        ("normal", np.float32, 3),
        ("uv", np.float32, 2),
        ("tint", np.float32, 3),
        ("label", np.int32),
    ]
)
"""Meters, unit vector, texture repetitions, linear color, label."""


@dataclass(frozen=True, eq=False)
class Skin:
    """The pictures on a surface; they repeat with each unit of uv. Compared by identity."""

    base: NDArray[np.uint8]
    """Shape (H, W, 3), or (H, W) for gray: square roots of factors of the tint, see
    `textures.texture`."""

    normal: NDArray[np.uint8] | None = None
    """Shape (H, W, 3): normals as 255 (n + 1) / 2 along u, along v, and outwards."""


@dataclass(frozen=True)
class SkinnedMesh:
    """Triangles of one skin."""

    vertices: NDArray[np.void]
    """Shape (V,), of `VERTEX`."""

    faces: NDArray[np.uint32]
    """Shape (F, 3), counterclockwise seen from outside."""

    skin: Skin
    is_open: bool = False
    """Whether the surface is open, with a second mesh in the same place that faces the other way.
    """
