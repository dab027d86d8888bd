# SPDX-License-Identifier: Apache-2.0
"""Solids as shaded meshes: triangles with normals and colors.

Every triangle has its own three vertices, so that edges stay sharp. Of a room's floor, walls and
ceiling only the faces towards the inside are drawn, so that the room can be seen from outside.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.scenario import Scenario
from groundlink.scene.build import solids
from groundlink.world import mesh_asset
from groundlink.world.colors import srgb
from groundlink.world.objects.indoor_objects import build_room
from groundlink.world.solids import Material, Solid
from groundlink.world.solids import Mesh as MeshShape
from groundlink.world.terrain import BODY
from groundlink.world.triangles import merged

from . import simplified_surfaces

Reals = NDArray[np.float32]


@dataclass(frozen=True)
class ShadedMesh:
    """Triangles: vertices 3 i to 3 i + 2 are one, counterclockwise from outside."""

    vertices: Reals
    """Shape (3 F, 3), meters."""

    normals: Reals
    """Shape (3 F, 3), unit vectors."""

    colors: NDArray[np.uint8]
    """Shape (3 F, 4): red, green, blue, opacity; sRGB."""


def mesh(solids: Sequence[Solid], materials: Mapping[str, Material]) -> ShadedMesh:
    """Return solids as one mesh in the frame of their poses."""
    plain = [solid for solid in solids if not isinstance(solid.shape, MeshShape)]
    triangles = merged(plain)
    corners = [triangles.vertices[triangles.faces].astype(np.float64)]
    colors = np.array([materials[solid.material].color for solid in plain]).reshape(-1, 3)
    colors_of_faces = [colors[triangles.labels]]
    for solid in solids:
        if isinstance(solid.shape, MeshShape):
            frame_from_solid = matrix_from_quaternion(solid.orientation)
            surface = mesh_asset.load_mesh(solid.shape.asset)
            local, kept = simplified_surfaces.coarse(surface)
            placed = local @ frame_from_solid.T + solid.position_m
            seen = simplified_surfaces.face_colors(surface, materials[solid.material])[kept]
            # Scans are open surfaces, which are drawn on both sides.
            corners += [placed, placed[:, ::-1]]
            colors_of_faces += [seen, seen]
    return _soup(np.concatenate(corners), np.concatenate(colors_of_faces))


def _soup(corners: Floats, linear: Floats) -> ShadedMesh:
    """Return faces with corners, shape (F, 3, 3), and colors, shape (F, 3), as a mesh."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    colors = np.full((len(corners), 4), 255, np.uint8)
    colors[:, :3] = np.rint(255 * srgb(linear))
    return ShadedMesh(
        corners.reshape(-1, 3).astype(np.float32),
        np.repeat(normals, 3, axis=0).astype(np.float32),
        np.repeat(colors, 3, axis=0),
    )


def rgba(linear: Sequence[float]) -> tuple[int, int, int, int]:
    """Return a linear color, 0..1, as sRGB with full opacity."""
    red, green, blue = np.rint(255 * srgb(np.asarray(linear, np.float64))).astype(int).tolist()
    return red, green, blue, 255


def world(scenario: Scenario) -> dict[str, ShadedMesh]:
    """Return static meshes in the world frame: one for the room, one for each object in it."""
    materials, room = scenario.world.materials, scenario.world.room
    shell = {solid.name for solid in build_room(room)} if room else set()
    inside = [solid for solid in solids(scenario) if solid.name in shell]
    meshes = {}
    if room and inside:
        center = (0.0, 0.0, room.size_m[2] / 2)
        meshes["room"] = facing(mesh(inside, materials), center)
    things: dict[str, list[Solid]] = {}
    for solid in solids(scenario):
        if solid.name not in shell:
            things.setdefault(thing(solid.name), []).append(solid)
    if ground := terrain(scenario):
        meshes[BODY] = ground
    return meshes | {name: mesh(parts, materials) for name, parts in things.items()}


def terrain(scenario: Scenario) -> ShadedMesh | None:
    """Return a world's terrain; None without any."""
    if scenario.world.terrain is None:
        return None
    return _soup(*simplified_surfaces.terrain_faces(scenario, scenario.world.terrain))


def thing(part: str) -> str:
    """Return the object of a part: `table_3` for `table_3_leg_0`; all clutter is one object."""
    kind, _, rest = part.partition("_")
    number = rest.partition("_")[0]
    return kind if kind == "clutter" or not number.isdecimal() else f"{kind}_{number}"


def facing(whole: ShadedMesh, point: Sequence[float]) -> ShadedMesh:
    """Return the triangles of a mesh that face a point."""
    seen = np.einsum("ij,ij->i", whole.normals, np.subtract(point, whole.vertices)) > 0
    return ShadedMesh(whole.vertices[seen], whole.normals[seen], whole.colors[seen])
