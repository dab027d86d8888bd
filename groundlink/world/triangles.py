# SPDX-License-Identifier: Apache-2.0
"""Solids and terrain as triangles, for ray casting and drawing.

Surfaces are closed and wound so that normals point outwards; meshes stay as their files have them.
Vertices are float32. Round shapes are inscribed: no vertex lies outside the true surface, and the
chord of a wheel of 0.2 m radius is at most 2 mm short.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats, matrix_from_quaternion

from .cover import WaterArea
from .mesh_asset import load_mesh
from .solids import Box, Cylinder, Mesh, Shape, Solid, Sphere
from .terrain import Ground

FACETS = 24
"""Facets of a full turn; the chord is (1 - cos(pi / 24)) = 0.9 % of the radius inside."""

_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_CUBE_FACES = np.array(
    # Vertex number = 4 x + 2 y + z; two triangles for each of -x, +x, -y, +y, -z, +z.
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)


@dataclass(frozen=True)
class Triangles:
    """A triangle surface with a solid number for each face."""

    vertices: NDArray[np.float32]
    """Shape (V, 3), meters."""

    faces: NDArray[np.uint32]
    """Shape (F, 3), rows of three vertex numbers, counterclockwise seen from outside."""

    labels: NDArray[np.int32]
    """Shape (F,), the number of the solid of each face."""


def joined(*parts: Triangles) -> Triangles:
    """Return surfaces joined into one, with their labels."""
    first_vertex = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Triangles(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([p.faces + np.uint32(v) for p, v in zip(parts, first_vertex, strict=False)]),
        np.concatenate([part.labels for part in parts]),
    )


def of_ground(ground: Ground, *, first_label: int) -> Triangles:
    """Return a terrain as triangles; labels are `first_label` + material number."""
    rows, columns = ground.heights.shape
    x = ground.x0_m + ground.cell_m * np.arange(columns)
    y = ground.y0_m + ground.cell_m * np.arange(rows)
    vertices = np.empty((rows, columns, 3), np.float32)
    vertices[..., 0], vertices[..., 1], vertices[..., 2] = x, y[:, None], ground.heights
    number = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    return Triangles(
        vertices.reshape(-1, 3),
        np.stack([a, b, c, d, c, b], axis=-1).reshape(-1, 3),
        np.repeat(ground.surface.reshape(-1).astype(np.int32) + first_label, 2),
    )


def of_water(area: WaterArea, ground: Ground, *, label: int) -> Triangles:
    """Return the surface of water as far as there is terrain, seen from above."""
    rows, columns = ground.heights.shape
    first = np.array([ground.x0_m, ground.y0_m])
    last = first + ground.cell_m * (np.array([columns, rows]) - 1)
    (west, south), (east, north) = np.maximum(area.low_m, first), np.minimum(area.high_m, last)
    corners = [(west, south), (east, south), (east, north), (west, north)]
    is_there = west < east and south < north
    return Triangles(
        np.array([(*corner, area.level_m) for corner in corners], np.float32),
        np.array([(0, 1, 2), (0, 2, 3)] if is_there else np.empty((0, 3)), np.uint32),
        np.full(2 * is_there, label, np.int32),
    )


def merged(solids: Sequence[Solid], *, first_label: int = 0) -> Triangles:
    """Return one surface of all solids in the frame of their poses.

    Faces of ``solids[i]`` have the label `first_label` + i.
    """
    vertices, faces, labels = [np.empty((0, 3))], [np.empty((0, 3), np.intp)], []
    count = 0
    for label, solid in enumerate(solids, first_label):
        local, triangles = _triangles(solid.shape)
        frame_from_solid = matrix_from_quaternion(solid.orientation)
        vertices.append(local @ frame_from_solid.T + solid.position_m)
        faces.append(triangles + count)
        labels.append(np.full(len(triangles), label, np.int32))
        count += len(local)
    return Triangles(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(faces).astype(np.uint32),
        np.concatenate([np.empty(0, np.int32), *labels]),
    )


def _triangles(shape: Shape) -> tuple[Floats, NDArray[np.intp]]:
    """Return vertices, shape (V, 3), and faces, shape (F, 3), of a shape in its own frame."""
    match shape:
        case Box():
            return _CUBE * shape.size_m, _CUBE_FACES
        case Cylinder():
            radius, top = shape.radius_m, shape.length_m / 2
            return _revolved(np.array([(0, -top), (radius, -top), (radius, top), (0, top)]))
        case Sphere():
            latitude = np.linspace(-np.pi / 2, np.pi / 2, FACETS // 2 + 1)
            profile = np.stack([np.cos(latitude), np.sin(latitude)], axis=-1)
            profile[[0, -1], 0] = 0.0
            return _revolved(shape.radius_m * profile)
        case Mesh():
            mesh = load_mesh(shape.asset)
            return mesh.vertices.astype(np.float64), mesh.faces.astype(np.intp)


def _revolved(profile: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return the surface that a profile sweeps about z; its ends lie on the axis.

    Parameters
    ----------
    profile : float64 array, shape (P, 2)
        Distance from the axis and height, from the lowest point to the highest.
    """
    turn = np.arange(FACETS) * (2 * np.pi / FACETS)
    radius, height = profile[1:-1, :1], profile[1:-1, 1:]
    rings = np.stack(np.broadcast_arrays(radius * np.cos(turn), radius * np.sin(turn), height), -1)
    poles = [[[0.0, 0.0, height]] for height in profile[[0, -1], 1]]
    vertices = np.concatenate([poles[0], rings.reshape(-1, 3), poles[1]])

    inner = 1 + np.arange(rings.shape[0] * FACETS).reshape(-1, FACETS)
    number = np.vstack(
        [np.zeros_like(inner[:1]), inner, np.full_like(inner[:1], inner[-1, -1] + 1)]
    )
    a, b = number[:-1], number[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    lower = np.stack([a, a_next, b_next], axis=-1)[1:]  # At a pole one triangle of each pair has
    upper = np.stack([a, b_next, b], axis=-1)[:-1]  # no area: it is left out.
    return vertices, np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])
