# SPDX-License-Identifier: Apache-2.0
"""Mesh assets: triangles with colors and textures, in a format of their own.

Vertices are in meters, x forward, y left, z up, in the frame of the solid. Reading an asset needs
no library of a file format; `groundlink.importing` converts files into assets.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundlink.core.fields import Vector3
from groundlink.world import assets
from groundlink.world.assets import MissingAsset

D = TypeVar("D", bound=np.generic)

_CANONICAL = msgspec.msgpack.Encoder(order="deterministic")


class MeshPart(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Consecutive faces with the same appearance."""

    first: int
    """Number of the first face."""

    count: int
    """Of faces."""

    color: Vector3 | None = None
    """Linear red, green, blue, 0..1, multiplied with the picture; None: color of the material."""

    picture: bytes | None = None
    """PNG or JPEG, gamma-coded: the color at `TriangleMesh.uv`."""

    normals: bytes | None = None
    """PNG or JPEG: unit normals as (n + 1) / 2 along u, along v and outwards."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A mesh in memory."""

    vertices: NDArray[np.float32]
    """Shape (V, 3), meters, read-only."""

    faces: NDArray[np.uint32]
    """Shape (F, 3), rows of three vertex numbers, counterclockwise seen from outside, read-only."""

    uv: NDArray[np.float32] | None
    """Shape (V, 2): where on its picture a vertex is: (0, 0) is its lower left corner, (1, 1) its
    upper right one, and beyond it repeats."""

    parts: tuple[MeshPart, ...]
    """Together all faces, in order."""


class _File(msgspec.Struct, frozen=True, kw_only=True, tag_field="format", tag="mesh-1"):
    """Contents of an asset as MessagePack, with little-endian numbers."""

    vertices: memoryview
    faces: memoryview
    uv: memoryview | None
    parts: tuple[MeshPart, ...]


@lru_cache(maxsize=256)
def load_mesh(asset: str) -> TriangleMesh:
    """Return the mesh that an asset is.

    Raises
    ------
    MissingAsset
        when the store does not hold it, or what it holds is no mesh.
    """
    try:
        file = msgspec.msgpack.decode(assets.map_asset(asset), type=_File)
        vertices = _array(file.vertices, np.float32, 3)
        faces = _array(file.faces, np.uint32, 3)
        uv = None if file.uv is None else _array(file.uv, np.float32, 2)
        if faces.max(initial=0) >= len(vertices) or (uv is not None and len(uv) != len(vertices)):
            raise ValueError
        if sum(part.count for part in file.parts) != len(faces):
            raise ValueError
    except (msgspec.MsgspecError, ValueError):
        raise MissingAsset(f"the world's data {asset[:12]} are no mesh") from None
    return TriangleMesh(vertices=vertices, faces=faces, uv=uv, parts=file.parts)


def encode_mesh(
    vertices: NDArray[np.float32],
    faces: NDArray[np.uint32],
    uv: NDArray[np.float32] | None = None,
    parts: Sequence[MeshPart] = (),
) -> bytes:
    """Return a mesh as the bytes of an asset, the same for the same values on every machine.

    Without `parts`, all faces form one part without a color of its own.
    """
    file = _File(
        vertices=memoryview(np.ascontiguousarray(vertices, "<f4").tobytes()),
        faces=memoryview(np.ascontiguousarray(faces, "<u4").tobytes()),
        uv=None if uv is None else memoryview(np.ascontiguousarray(uv, "<f4").tobytes()),
        parts=tuple(parts) or (MeshPart(first=0, count=len(faces)),),
    )
    return _CANONICAL.encode(file)


def _array(content: memoryview, dtype: type[D], columns: int) -> NDArray[D]:
    """Return a read-only copy of rows of numbers; in the file they are not aligned."""
    array = np.frombuffer(content, dtype).reshape(-1, columns).copy()
    array.flags.writeable = False
    return array
