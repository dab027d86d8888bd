# SPDX-License-Identifier: Apache-2.0
"""Interface of ray engines, which find the first triangle of a mesh on a ray.

An engine knows no motion; `tracer.c` handles motion and computes the exact hit on the triangle. So
all engines give the same ranges, except for rays within some micrometers of an edge.
"""

from collections.abc import Iterator, Sequence
from ctypes import c_void_p
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from groundlink.world.triangles import Triangles

_ALIGNMENT = 64
_PADDING_BYTES = 16
"""Embree may read this far past the last element of a buffer."""


def aligned(shape: Sequence[int], dtype: type[np.generic]) -> NDArray[Any]:
    """Return a zeroed array that starts on a cache line and may be read past its end."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.zeros(size + _PADDING_BYTES + _ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % _ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)


@dataclass(frozen=True)
class SceneMeshes:
    """All triangles of a scene in joined arrays: the static world's, then each body's."""

    vertices: NDArray[np.float32]
    """Shape (V, 3), meters, each in the frame of its mesh."""

    faces: NDArray[np.uint32]
    """Shape (F, 3), numbers of vertices."""

    labels: NDArray[np.int32]
    """Shape (F,)."""

    first_triangle: NDArray[np.int32]
    """Shape (meshes + 1,): where the faces of each mesh begin, and the end."""

    @classmethod
    def joined(cls, meshes: Sequence[Triangles]) -> "SceneMeshes":
        """Join meshes."""
        first_vertex = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        first_triangle = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        vertices = aligned((int(first_vertex[-1]), 3), np.float32)
        faces = aligned((int(first_triangle[-1]), 3), np.uint32)
        for mesh, vertex, face in zip(meshes, first_vertex, first_triangle, strict=False):
            vertices[vertex : vertex + len(mesh.vertices)] = mesh.vertices
            faces[face : face + len(mesh.faces)] = mesh.faces + np.uint32(vertex)
        labels = np.concatenate([mesh.labels for mesh in meshes])
        return cls(vertices, faces, labels, first_triangle.astype(np.int32))

    def each(self) -> Iterator[NDArray[np.uint32]]:
        """Yield the faces of each mesh."""
        ends = self.first_triangle.tolist()
        for begin, end in pairwise(ends):
            yield self.faces[begin:end]


class RayEngine(Protocol):
    """Finds the first triangle on a ray in static meshes."""

    def __init__(self, meshes: SceneMeshes) -> None:
        """Build acceleration structures; the meshes' arrays may be read in place."""

    @property
    def intersect(self) -> c_void_p:
        """Function with the interface of Embree's rtcIntersect8, as in `rays.h`."""

    @property
    def scenes(self) -> Sequence[int]:
        """Second argument of `intersect` for each mesh."""
