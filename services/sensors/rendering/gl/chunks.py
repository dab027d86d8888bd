# SPDX-License-Identifier: Apache-2.0
"""Split meshes into chunks, so that only chunks in view are drawn.

Splitting moves no vertex and cuts no triangle.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from services.sensors.rendering.look.mesh import SkinnedMesh

from .culling import Boxes


def cut(mesh: SkinnedMesh, edge_m: float) -> Iterator[SkinnedMesh]:
    """Yield the chunks of a mesh: the faces whose centers share one cell of space."""
    middles = mesh.vertices["position"][mesh.faces].mean(axis=1)
    cells, of_face = np.unique(np.floor(middles / edge_m), axis=0, return_inverse=True)
    of_face = of_face.reshape(-1)
    ends = np.cumsum(np.bincount(of_face, minlength=len(cells)))
    for faces in np.split(mesh.faces[np.argsort(of_face, kind="stable")], ends[:-1]):
        used, numbers = np.unique(faces, return_inverse=True)
        faces = numbers.reshape(-1, 3).astype(np.uint32)
        yield replace(mesh, vertices=mesh.vertices[used], faces=faces)


def boxes_around(made: Sequence[SkinnedMesh]) -> Boxes:
    """Return the box around each mesh."""
    positions = [mesh.vertices["position"].astype(np.float64) for mesh in made]
    lows, highs = ([f(p, axis=0) for p in positions] for f in (np.min, np.max))
    return Boxes.around(np.reshape(lows, (-1, 3)), np.reshape(highs, (-1, 3)))
