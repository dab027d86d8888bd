# SPDX-License-Identifier: Apache-2.0
"""Bounding volume trees, and the ray engine for machines without Embree.

The engine is plain C: the same ranges, three to nine times slower.
"""

import ctypes
from ctypes import c_void_p

import numpy as np
from numpy.typing import NDArray

from .engine import SceneMeshes
from .kernels import kernels

_NODE_BYTES = 32


class BoxTree:
    """A tree of boxes, built by `tree.c` and traversed by the other loops in C.

    Parameters
    ----------
    boxes : float32 array, shape (N, 2, 3)
        Lowest and highest corner of each.
    leaf_items : int
        Most boxes of a leaf.

    Attributes
    ----------
    nodes : uint8 array
        Structures `node` of `rays.h`.
    order : int32 array, shape (N,)
        Numbers of the boxes, leaf after leaf.
    """

    def __init__(self, boxes: NDArray[np.float32], *, leaf_items: int) -> None:
        self.nodes = np.empty((2 * len(boxes), _NODE_BYTES), np.uint8)
        self.order = np.empty(len(boxes), np.int32)
        if len(boxes):
            boxes = np.ascontiguousarray(boxes, np.float32)
            kernels().groundlink_tree(
                *(boxes.ctypes.data, len(boxes), leaf_items),
                *(self.order.ctypes.data, self.nodes.ctypes.data),
            )


LEAF_TRIANGLES = 4
"""Triangles of a leaf, which cost as much as checking another pair of boxes."""


class _Mesh(ctypes.Structure):
    """The structure `mesh` of `builtin.c`."""

    _fields_ = tuple((name, c_void_p) for name in ("vertices", "faces", "nodes", "order"))


class BuiltinEngine:
    """Implements `RayEngine` with `builtin.c`."""

    def __init__(self, meshes: SceneMeshes) -> None:
        self._meshes = meshes
        self._trees = [_tree(meshes.vertices[faces[:, :3]]) for faces in meshes.each()]
        self._structures = [
            _Mesh(
                *(meshes.vertices.ctypes.data, faces.ctypes.data),
                *(tree.nodes.ctypes.data if len(faces) else None, tree.order.ctypes.data),
            )
            for faces, tree in zip(meshes.each(), self._trees, strict=True)
        ]
        self.intersect = ctypes.cast(kernels().groundlink_intersect8, c_void_p)
        self.scenes = [ctypes.addressof(mesh) for mesh in self._structures]


def _tree(corners: NDArray[np.float32]) -> BoxTree:
    """Return the tree of triangles, shape (faces, 3, 3)."""
    boxes = np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
    return BoxTree(boxes, leaf_items=LEAF_TRIANGLES)
