# SPDX-License-Identifier: Apache-2.0
"""Triangles with what makes them look like something: normals, colours, textures, labels.

Rule: a mesh is what a renderer draws and nothing more; where it comes from is its maker's business:
`shapes` makes them of solids, `painted` of meshes that bring their own colours.
"""

from __future__ import annotations

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
"""Metres, unit vector, texture repetitions, linear colour, number of the thing."""


@dataclass(frozen=True, eq=False)
class Skin:
    """The pictures on a surface; they repeat with each unit of uv. Skins are told by identity."""

    base: NDArray[np.uint8]
    """Shape (H, W, 3), or (H, W) for grey: roots of factors of the tint, see `textures.texture`."""

    normal: NDArray[np.uint8] | None = None
    """Shape (H, W, 3): normals as 255 (n + 1) / 2 along u, along v, and outwards."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one skin."""

    vertices: NDArray[np.void]
    """Shape (V,), of `VERTEX`."""

    faces: NDArray[np.uint32]
    """Shape (F, 3), anticlockwise seen from outside."""

    skin: Skin
    is_open: bool = False
    """It lies in one place with another that faces the other way, as the surface is open."""
