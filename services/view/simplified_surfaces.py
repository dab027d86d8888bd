# SPDX-License-Identifier: Apache-2.0
"""Terrain and meshes with fewer triangles than sensors and physics use.

Each fits into one message. Close vertices of a large mesh are merged. Terrain has its full
resolution where vehicles start and less elsewhere, on one grid without gaps.
"""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario import Scenario
from groundlink.world.colors import linear
from groundlink.world.mesh_asset import MeshPart, TriangleMesh
from groundlink.world.solids import Material
from groundlink.world.terrain import Ground, Terrain, load_ground
from groundlink.world.triangles import of_water

MOST_FACES = 50_000
"""Most faces of one mesh."""

COARSE_CELLS = 150
"""Cells of terrain along each axis."""

FINE_CELLS = 40
"""Cells at full resolution to each side of a vehicle's start."""


def coarse(mesh: TriangleMesh) -> tuple[Floats, NDArray[np.intp]]:
    """Return corners of faces, shape (F, 3, 3), and the index of each face in the mesh."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    if len(corners) <= MOST_FACES:
        return corners, np.arange(len(corners))
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    edge_m = np.sqrt(np.linalg.norm(across, axis=1).sum() / MOST_FACES)
    while True:
        cubes = np.floor(mesh.vertices / edge_m).astype(np.int64)
        _, place, count = np.unique(cubes, axis=0, return_inverse=True, return_counts=True)
        place = place.reshape(-1)
        sums = [np.bincount(place, axis, len(count)) for axis in mesh.vertices.T]
        means = np.stack(sums, axis=-1) / count[:, None]
        faces = place[mesh.faces]
        a, b, c = faces.T
        kept = np.flatnonzero((a != b) & (b != c) & (c != a))
        _, first = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
        kept = kept[first]
        if len(kept) <= MOST_FACES:
            return means[faces[kept]], kept
        edge_m *= 1.3


def face_colors(mesh: TriangleMesh, material: Material) -> Floats:
    """Return the linear colors of a mesh's faces, shape (F, 3); a texture's at the center."""
    colors = np.empty((len(mesh.faces), 3))
    for part in mesh.parts:
        own = slice(part.first, part.first + part.count)
        colors[own] = material.color if part.color is None else part.color
        if part.picture is not None and mesh.uv is not None:
            colors[own] = _sampled(part, mesh.uv[mesh.faces[own]].mean(axis=1))
    return colors


def _sampled(part: MeshPart, uv: Floats) -> Floats:
    from PIL import Image

    assert part.picture is not None
    with Image.open(BytesIO(part.picture)) as picture:
        pixels = np.asarray(picture.convert("RGB"))
    height, width = pixels.shape[:2]
    column = (uv[:, 0] % 1 * width).astype(int) % width
    row = ((1 - uv[:, 1]) % 1 * height).astype(int) % height
    return linear(pixels[row, column] / 255) * (part.color or (1.0, 1.0, 1.0))


def terrain_faces(scenario: Scenario, terrain: Terrain) -> tuple[Floats, Floats]:
    """Return corners of faces, shape (F, 3, 3), and their linear colors, shape (F, 3).

    Standing water is part of it.
    """
    here = load_ground(terrain)
    rows, columns = here.heights.shape
    starts = [vehicle.placement for vehicle in scenario.vehicles]
    row = _lines(rows, [(start.y_m - here.y0_m) / here.cell_m for start in starts])
    column = _lines(columns, [(start.x_m - here.x0_m) / here.cell_m for start in starts])
    points = _points(here, row, column)
    a, b = points[:-1, :-1], points[:-1, 1:]
    c, d = points[1:, :-1], points[1:, 1:]
    faces = np.stack([np.stack([a, b, c], axis=-2), np.stack([d, c, b], axis=-2)], axis=2)
    color = np.array([scenario.world.materials[name].color for name in here.materials])
    middle_row, middle_column = (row[:-1] + row[1:]) // 2, (column[:-1] + column[1:]) // 2
    of_cell = color[here.surface[np.ix_(middle_row, middle_column)]]
    corners, colors = [faces.reshape(-1, 3, 3)], [of_cell.reshape(-1, 3).repeat(2, axis=0)]
    for area in scenario.world.water:
        sheet = of_water(area, here, label=0)
        corners.append(sheet.vertices[sheet.faces].astype(np.float64))
        colors.append(np.tile(scenario.world.materials[area.material].color, (len(sheet.faces), 1)))
    return np.concatenate(corners), np.concatenate(colors)


def _points(here: Ground, row: NDArray[np.intp], column: NDArray[np.intp]) -> Floats:
    x, y = np.meshgrid(here.x0_m + column * here.cell_m, here.y0_m + row * here.cell_m)
    return np.stack([x, y, here.heights[np.ix_(row, column)]], axis=-1)


def _lines(count: int, fine_at: list[float]) -> NDArray[np.intp]:
    """Return which of `count` rows or columns of heights are drawn."""
    near = [np.arange(round(at) - FINE_CELLS, round(at) + FINE_CELLS + 1) for at in fine_at]
    spread = np.linspace(0, count - 1, min(count, COARSE_CELLS + 1)).astype(np.intp)
    lines = np.unique(np.concatenate([spread, *near]).astype(np.intp))
    return lines[(lines >= 0) & (lines < count)]
