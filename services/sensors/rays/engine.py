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
    """All triangles of a scene in joined arrays; bodies of the same shape share a mesh."""

    vertices: NDArray[np.float32]
    """Shape (V, 3), meters, each in the frame of its mesh."""

    faces: NDArray[np.uint32]
    """Shape (F, 4): numbers of three vertices, and the label less its mesh's first one."""

    ends: tuple[int, ...]
    """Where the faces of each mesh end, the first mesh being that of the static world."""

    mesh: NDArray[np.int32]
    """Shape (1 + bodies,): mesh of the static world, then of each body."""

    first_label: NDArray[np.int32]
    """Shape (1 + bodies,)."""

    @classmethod
    def joined(cls, static: Triangles, bodies: Sequence[Triangles]) -> "SceneMeshes":
        """Join meshes."""
        first_label = [int(mesh.labels.min(initial=2**31 - 1)) for mesh in (static, *bodies)]
        known: dict[tuple[bytes, ...], int] = {}
        meshes, used = [static], [0]
        for body, first in zip(bodies, first_label[1:], strict=True):
            labels = body.labels - np.int32(first)
            key = body.vertices.tobytes(), body.faces.tobytes(), labels.tobytes()
            used.append(known.setdefault(key, len(meshes)))
            if used[-1] == len(meshes):
                meshes.append(body)
        first_vertex = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        first_face = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        vertices = aligned((int(first_vertex[-1]), 3), np.float32)
        faces = aligned((int(first_face[-1]), 4), np.uint32)
        for number, (mesh, vertex, face) in enumerate(
            zip(meshes, first_vertex, first_face, strict=False)
        ):
            vertices[vertex : vertex + len(mesh.vertices)] = mesh.vertices
            own = faces[face : face + len(mesh.faces)]
            own[:, :3] = mesh.faces + np.uint32(vertex)
            own[:, 3] = mesh.labels - first_label[used.index(number)]
        return cls(
            *(vertices, faces, tuple(first_face.tolist())),
            *(np.array(numbers, np.int32) for numbers in (used, first_label)),
        )

    def each(self) -> Iterator[NDArray[np.uint32]]:
        """Yield the faces of each mesh."""
        for begin, end in pairwise(self.ends):
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
