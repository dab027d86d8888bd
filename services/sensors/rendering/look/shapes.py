# SPDX-License-Identifier: Apache-2.0
"""Meshes of solids: normals, texture coordinates, colors and textures of their materials.

The triangles are those that rays hit: `groundlink.world.triangles`.
"""

from collections.abc import Mapping, Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.world import solids as world
from groundlink.world.solids import Box, Cylinder, Material, Shape, Solid, Sphere
from groundlink.world.triangles import merged

from .mesh import VERTEX, Skin, SkinnedMesh
from .painted import painted
from .textures import period_m, texture

TINT = 0.12
"""Largest difference in brightness between objects of one material."""

STRETCH = 0.15
"""Largest scaling of the texture in each direction; some objects also have it mirrored. So two
objects that show the same part of a texture differ from every viewpoint, and place recognition
can't confuse them."""


def meshes(
    solids: Sequence[Solid],
    labels: Sequence[int],
    materials: Mapping[str, Material],
    skins: dict[str, Skin],
) -> list[SkinnedMesh]:
    """Return solids in the frame of their poses, one mesh for each texture.

    A solid that is a mesh gives one mesh for each of its parts.

    Parameters
    ----------
    labels
        Label of each solid.
    skins
        Skins by texture; new ones are added.
    """
    corners: dict[str, list[NDArray[np.void]]] = {}
    made: list[SkinnedMesh] = []
    for solid, label in zip(solids, labels, strict=True):
        material = materials[solid.material]
        if isinstance(solid.shape, world.Mesh):
            made += painted(solid, label, material, skins)
            continue
        beside = corners.setdefault(material.texture, [])
        began = beside[-1]["uv"][:, 1].max() % 1 if beside else 0.0
        beside.append(_corners(solid, label, material, began))
    for name, parts in corners.items():
        skin = skins.setdefault(name, Skin(texture(name)))
        vertices, faces = np.unique(np.concatenate(parts), return_inverse=True)
        made.append(SkinnedMesh(vertices, faces.reshape(-1, 3).astype(np.uint32), skin))
    return made


def _corners(solid: Solid, label: int, material: Material, began: float) -> NDArray[np.void]:
    """Return a solid's triangles as three vertices each, shape (3 F,).

    Their texture begins at v = `began`, where that of the previous solid ends: no two walls show
    the same part until the texture is used up.
    """
    triangles = merged([Solid("", solid.shape, "")])
    local = triangles.vertices[triangles.faces].astype(np.float64)
    normals, uv_m = _around(solid.shape, local)
    frame_from_solid = matrix_from_quaternion(solid.orientation)
    placed = merged([solid])
    *stretch, across, mirrored = crc32(solid.name.encode()).to_bytes(4, "little")
    uv = (uv_m / period_m(material)).reshape(-1, 2)
    uv *= 1 + STRETCH * (np.array(stretch) / 127.5 - 1)
    uv[:, 0] *= 1 - 2 * (mirrored % 2)
    uv += np.array([across / 256, began - uv[:, 1].min()])
    shade, *_ = crc32(str(label).encode()).to_bytes(4, "little")
    vertices = np.empty(3 * len(local), VERTEX)
    vertices["position"] = placed.vertices[placed.faces].reshape(-1, 3)
    vertices["normal"] = (normals @ frame_from_solid.T).reshape(-1, 3)
    vertices["uv"] = uv
    vertices["tint"] = np.array(material.color) * (1 + TINT * (shade / 127.5 - 1))
    vertices["label"] = label
    return vertices


def _around(shape: Shape, corners: Floats) -> tuple[Floats, Floats]:
    """Return normals, shape (F, 3, 3), and places on the surface in meters, shape (F, 3, 2).

    Both are in the shape's frame, for the corners (F, 3, 3) of its triangles.
    """
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    flat = np.repeat(flat[:, None], 3, axis=1)
    if isinstance(shape, Box):
        return flat, _unfolded(corners, flat, shape.size_m)
    assert isinstance(shape, Sphere | Cylinder)
    radius, angle = shape.radius_m, _angles(corners)
    if isinstance(shape, Sphere):
        latitude = np.arcsin(np.clip(corners[..., 2] / radius, -1, 1))
        return corners / radius, np.stack([angle * radius, latitude * radius], -1)
    cap = np.abs(flat[..., 2:]) > 0.5
    side = corners * (1, 1, 0) / radius
    rolled_out = np.stack([corners[..., 2], angle * radius], -1)
    return np.where(cap, flat, side), np.where(cap, corners[..., :2], rolled_out)


def _unfolded(corners: Floats, flat: Floats, size_m: Sequence[float]) -> Floats:
    """Return the two coordinates in a box's faces, the one along its longer edge first.

    Faces lie side by side. Opposite faces overlap, because nobody sees both.
    """
    uv = np.empty((*corners.shape[:2], 2))
    facing = np.abs(flat[:, 0]).argmax(axis=1)
    began_m = 0.0
    for axis in range(3):
        along, across = sorted({0, 1, 2} - {axis}, key=lambda i: -size_m[i])
        here = facing == axis
        uv[here] = corners[here][..., [along, across]]
        uv[here, :, 1] += began_m + size_m[across] / 2
        began_m += size_m[across]
    return uv


def _angles(corners: Floats) -> Floats:
    """Return the angle about z of each corner, without a jump within a triangle, shape (F, 3)."""
    middle = corners.mean(axis=1)
    about = np.arctan2(middle[:, 1], middle[:, 0])[:, None]
    angle = np.arctan2(corners[..., 1], corners[..., 0]) - about
    # A pole has no angle of its own.
    pole = np.hypot(corners[..., 0], corners[..., 1]) < 1e-9
    wrapped: Floats = np.where(pole, 0.0, (angle + np.pi) % (2 * np.pi) - np.pi) + about
    return wrapped
