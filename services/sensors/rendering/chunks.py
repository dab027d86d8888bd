# SPDX-License-Identifier: Apache-2.0
"""Meshes in pieces, so that only what a view can show is drawn.

Rule: cutting moves no vertex and splits no triangle.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .culling import Boxes
from .mesh import Mesh


def cut(mesh: Mesh, edge_m: float) -> Iterator[Mesh]:
    """Yield a mesh in pieces: the faces whose middles are in one cell of space each."""
    middles = mesh.vertices["position"][mesh.faces].mean(axis=1)
    cells, of_face = np.unique(np.floor(middles / edge_m), axis=0, return_inverse=True)
    for cell in range(len(cells)):
        faces = mesh.faces[of_face.reshape(-1) == cell]
        used, numbers = np.unique(faces, return_inverse=True)
        faces = numbers.reshape(-1, 3).astype(np.uint32)
        yield Mesh(mesh.vertices[used], faces, mesh.skin)


def boxes_around(made: Sequence[Mesh]) -> Boxes:
    """Return the box around each mesh."""
    positions = [mesh.vertices["position"].astype(np.float64) for mesh in made]
    lows, highs = ([f(p, axis=0) for p in positions] for f in (np.min, np.max))
    return Boxes.around(np.reshape(lows, (-1, 3)), np.reshape(highs, (-1, 3)))
