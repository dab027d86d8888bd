# SPDX-License-Identifier: Apache-2.0
"""Meshes with colors and pictures of their own.

The triangles are those that rays hit, on both sides where the surface is open. A part without a
picture has its material's texture, a part without a color its material's color. Normals of files
are ignored: normals are smooth except across edges of `CREASE` and more.
"""

import math
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.world import solids
from groundlink.world.mesh_asset import MeshPart, TriangleMesh, load_mesh
from groundlink.world.solids import Material, Solid
from groundlink.world.triangles import merged

from .mesh import VERTEX, Skin, SkinnedMesh
from .textures import BRIGHTEST, period_m, texture

CREASE = math.cos(math.radians(40.0))
"""Angle between faces from which an edge separates them."""

MOST_TEXELS = 4096
"""Largest side of a picture in pixels; larger pictures are scaled down."""

WHITE = np.full((1, 1, 3), 255, np.uint8)


def painted(
    solid: Solid, label: int, material: Material, skins: dict[str, Skin]
) -> Iterator[SkinnedMesh]:
    """Yield a solid that is a mesh, in the frame of its pose: one mesh for each part.

    Parameters
    ----------
    label
        Label of the solid.
    material
        Material of parts without their own.
    skins
        Skins by texture or picture; new ones are added.
    """
    assert isinstance(solid.shape, solids.Mesh)
    mesh = load_mesh(solid.shape.asset)
    placed = merged([solid])
    smooth, closed = _normals(mesh)
    smooth = smooth @ matrix_from_quaternion(solid.orientation).T
    for number, part in enumerate(mesh.parts):
        here = slice(part.first, part.first + part.count)
        faces, normals = mesh.faces[here], smooth[here]
        corners = np.empty((len(faces), 3), VERTEX)
        corners["position"] = placed.vertices[faces]
        corners["normal"] = normals
        corners["label"] = label
        numbers = faces.astype(np.int64)
        if mesh.uv is not None and (part.picture or part.normals):
            # Pictures have their first row at the top.
            corners["uv"] = mesh.uv[faces] * (1, -1) + (0, 1)
            corners["tint"] = np.array(part.color or (1.0, 1.0, 1.0)) / BRIGHTEST
            name = f"{solid.shape.asset}/{number}"
            if name not in skins:
                skins[name] = _skin(part)
        else:
            kept = _across(mesh.vertices[faces])
            corners["uv"] = np.take_along_axis(mesh.vertices[faces], kept[:, None], axis=2)
            corners["uv"] /= period_m(material)
            numbers = 4 * numbers + kept[:, :1] + kept[:, 1:]  # no vertex has two texture places
            corners["tint"] = part.color or material.color
            name = material.texture
            if name not in skins:
                skins[name] = Skin(texture(material.texture))
        vertices, indices = _shared(corners.ravel(), numbers.ravel())
        yield SkinnedMesh(vertices, indices, skins[name], is_open=not closed)
        if not closed:
            vertices = vertices.copy()
            vertices["normal"] *= -1
            faces = np.ascontiguousarray(indices[:, ::-1])
            yield SkinnedMesh(vertices, faces, skins[name], is_open=True)


def _normals(mesh: TriangleMesh) -> tuple[Floats, bool]:
    """Return normals of the faces' corners, shape (F, 3, 3), and whether the surface is closed.

    A corner's normal is the mean, weighted by angle, of the surrounding faces that meet its own
    face smoothly. Vertices at one place count as one.
    """
    rows = np.ascontiguousarray(mesh.vertices + np.float32(0)).view("V12").ravel()
    vertex = np.unique(rows, return_inverse=True)[1].ravel()[mesh.faces]
    points = mesh.vertices[mesh.faces].astype(np.float64)
    edges = _unit(np.roll(points, -1, axis=1) - points)
    flat = _unit(np.cross(edges[:, 0], edges[:, 1]))
    angles = np.arccos(np.clip(-np.einsum("fij,fij->fi", edges, np.roll(edges, 1, axis=1)), -1, 1))
    order = np.argsort(vertex.ravel(), kind="stable")
    at, face = vertex.ravel()[order], order // 3
    weighted = angles.ravel()[order, None] * flat[face]
    total = weighted.copy()
    first, apart = np.arange(len(at)), 0
    while len(first):
        # Corners of one vertex are adjacent: compare each with the next one, then with the one
        # after it
        apart += 1
        first = first[first + apart < len(at)]
        first = first[at[first] == at[first + apart]]
        one, other = face[first], face[first + apart]
        smooth = np.einsum("ij,ij->i", flat[one], flat[other]) > CREASE
        total[first[smooth]] += weighted[first[smooth] + apart]
        total[first[smooth] + apart] += weighted[first[smooth]]
    normals = np.empty_like(total)
    normals[order] = _unit(total)
    begin, end = vertex.ravel(), np.roll(vertex, -1, axis=1).ravel()
    there, back = (np.sort(a * len(mesh.vertices) + b) for a, b in ((begin, end), (end, begin)))
    return normals.reshape(-1, 3, 3), bool(np.array_equal(there, back))


def _unit(vectors: Floats) -> Floats:
    """Return vectors scaled to length 1; vectors of length 0 stay."""
    unit: Floats = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
    return unit


def _shared(
    corners: NDArray[np.void], numbers: NDArray[np.int64]
) -> tuple[NDArray[np.void], NDArray[np.uint32]]:
    """Return each vertex once, and faces, shape (F, 3).

    Corners with equal `numbers` differ in their normals only.
    """
    normal = np.rint(511 * corners["normal"]).astype(np.int64) + 512
    key = numbers << 30 | normal[:, 0] << 20 | normal[:, 1] << 10 | normal[:, 2]
    _, first, faces = np.unique(key, return_index=True, return_inverse=True)
    return corners[first], faces.reshape(-1, 3).astype(np.uint32)


def _across(points: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return the two axes that each face, shape (F, 3, 3), is most parallel to, shape (F, 2)."""
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    kept: NDArray[np.intp] = np.array([[1, 2], [0, 2], [0, 1]])[np.abs(across).argmax(axis=1)]
    return kept


def _skin(part: MeshPart) -> Skin:
    """Return a part's pictures; a part with normals only is white."""
    bumps = None
    if part.normals:
        bumps = _decoded(part.normals)
        bumps[..., 1] = 255 - bumps[..., 1]  # v points down here
    return Skin(_decoded(part.picture) if part.picture else WHITE, bumps)


def _decoded(picture: bytes) -> NDArray[np.uint8]:
    """Return the pixels of a PNG or JPEG, shape (H, W, 3): red, green, blue.

    Raises
    ------
    UserError
        If it is neither.
    """
    pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    if pixels is None:
        raise UserError("a texture of a mesh is not PNG or JPEG. Fix: import the mesh again")
    shrunk = MOST_TEXELS / max(pixels.shape)
    if shrunk < 1:
        pixels = cv2.resize(pixels, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), np.uint8)
