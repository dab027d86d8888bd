# SPDX-License-Identifier: Apache-2.0
"""World files generated for one heightmap, mesh or occupancy map, with a report about the file.

The world of a heightmap or mesh is moved so that a vehicle can spawn at the origin: on the ground
in the middle of the map, or below the middle of the mesh. That of an occupancy map has the frame of
the map.
"""

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundlink.world.mesh_asset import TriangleMesh, load_mesh
from groundlink.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from groundlink.world.terrain import Ground, load_ground

from . import map_files, meshes, terrain
from .file_errors import Warn
from .map_specs import OccupancyMapFile
from .mesh_specs import MeshFile
from .terrain_specs import HeightmapFile

MATERIAL = "ground"

_MATERIALS = """\
# Estimates: correct them. Reflectivity is that at the LiDAR's wavelength, color is linear.
materials:
  {material}: {{reflectivity: 0.3, friction: 0.9, color: [{color}], texture: speckled}}
"""

MARGIN_M = 10.0
"""Margin of the floor around a mesh."""


def of_heightmap(spec: HeightmapFile, named: str, report: Warn, warn: Warn) -> str:
    """Return a world file for a heightmap, which it calls `named`.

    `report` receives what was found in the file, `warn` receives warnings.
    """
    made = load_ground(terrain.build(spec, Path(), warn))
    rows, columns = made.heights.shape
    middle_m = float(made.height_at(0.0, 0.0))
    report(
        f"{columns} x {rows} heights, cells of {made.cell_m:g} m: "
        f"{(columns - 1) * made.cell_m:g} x {(rows - 1) * made.cell_m:g} m"
    )
    report(
        f"heights from {made.heights.min():.2f} to {made.heights.max():.2f} m, "
        f"{middle_m:.2f} m in the middle; the steepest edge has {_steepest_deg(made):.0f} degrees"
    )
    report(f"{2 * (rows - 1) * (columns - 1):,} triangles")
    lines = [f"  kind: heightmap\n  file: {_quoted(named)}"]
    if spec.heights_m is not None:
        lines.append(f"  heights_m: [{spec.heights_m[0]:g}, {spec.heights_m[1]:g}]")
    return "\n".join(
        [
            f"# The heightmap {Path(named).name}; the origin is amid it, on the ground.",
            f"name: {_name(spec.file)}\n",
            _MATERIALS.format(material=MATERIAL, color="0.20, 0.24, 0.11"),
            "terrain:",
            *lines,
            f"  cell_m: {made.cell_m!r}",
            f"  at_m: [0.0, 0.0, {-middle_m:.3f}]",
            f"  material: {MATERIAL}\n",
        ]
    )


def of_mesh(spec: MeshFile, named: str, report: Warn, warn: Warn) -> str:
    """Return a world file for a mesh, which it calls `named`.

    `report` receives what was found in the file, `warn` receives warnings.
    """
    made = meshes.import_mesh(spec, Path(), warn)
    shape = made.shape()
    low, high = np.array(shape.low_m), np.array(shape.high_m)
    size = high - low
    mesh = load_mesh(shape.asset)
    report(f"{size[0]:.3f} x {size[1]:.3f} x {size[2]:.3f} m, from {_point(low)} to {_point(high)}")
    report(
        f"{len(mesh.faces):,} triangles, {len(mesh.vertices):,} vertices, "
        f"{len(mesh.parts)} kinds of paint, {_pictures(mesh)}"
    )
    if made.points:
        report(f"{made.points:,} points without faces, in the place of which there are discs")
    else:
        report(_holes(*open_edges(mesh)))
    at = -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    floor = [f"{math.ceil(length + 2 * MARGIN_M)}.0" for length in size[:2]]
    fields = [f"kind: mesh, file: {_quoted(named)}"]
    if spec.scale != 1.0:
        fields.append(f"scale: {spec.scale!r}")
    if spec.up is not None:
        fields.append(f"up: {spec.up}")
    name = _name(spec.file)
    return "\n".join(
        [
            f"# The mesh {Path(named).name}; the origin is below its middle, as low as it is.",
            f"name: {name}\n",
            _MATERIALS.format(material=MATERIAL, color="0.35, 0.34, 0.32"),
            "solids:",
            "  # Where the mesh has a floor of its own, leave this out and call the mesh drivable:"
            " true.",
            f"  - {{name: floor, shape: {{kind: box, size_m: [{', '.join(floor)}, 1.0]}}, "
            f"material: {MATERIAL}, position_m: [0.0, 0.0, -0.501]}}",
            f"  - name: {name}_mesh",
            f"    shape: {{{', '.join(fields)}}}",
            f"    material: {MATERIAL}",
            f"    position_m: {_point(at)}\n",
        ]
    )


def of_map(found: OccupancyMap, occupied_thresh: float, named: str, report: Warn) -> str:
    """Return a world file for an occupancy map, whose YAML file it calls `named`.

    `report` receives what was found in the file.

    Raises
    ------
    BadFile
        when no world can be made of it.
    """
    grid = found.grid
    report(
        f"{grid.columns} x {grid.rows} cells of {grid.resolution_m:g} m: "
        f"{grid.columns * grid.resolution_m:g} x {grid.rows * grid.resolution_m:g} m"
    )
    report(counts(found))
    walls = len(map_files.solids_of(found, OccupancyMapFile(file=named), occupied_thresh)) - 1
    report(f"{walls:,} boxes as walls")
    return "\n".join(
        [
            f"# The map {Path(named).name}; world and map have the same frame.",
            f"name: {_name(named)}\n",
            "map:",
            f"  file: {_quoted(named)}",
            "  wall_height_m: 2.5",
            "  wall_material: plaster",
            "  floor_material: linoleum\n",
        ]
    )


def counts(found: OccupancyMap) -> str:
    """Return how many cells of a map have which value, for people."""
    free, occupied, unknown = (
        int((found.cells == value).sum()) for value in (FREE, OCCUPIED, UNKNOWN)
    )
    between = found.cells.size - free - occupied - unknown
    return f"{occupied:,} cells occupied, {free:,} free, {unknown:,} unknown" + (
        f", {between:,} between" if between else ""
    )


def open_edges(mesh: TriangleMesh) -> tuple[int, int]:
    """Return the number of edges with a face on one side only, and of holes they surround."""
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corners = same.reshape(-1)[mesh.faces].astype(np.int64)
    edges = np.sort(corners[:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2), axis=1)
    _, first, count = np.unique(edges @ (same.max() + 1, 1), return_index=True, return_counts=True)
    rim = edges[first[count == 1]]
    return len(rim), _components(rim)


def _components(edges: NDArray[np.int64]) -> int:
    """Return the number of connected components of edges."""
    ends, numbers = np.unique(edges, return_inverse=True)
    a, b = numbers.reshape(-1, 2).T
    label = np.arange(len(ends))
    while True:
        before = label.copy()
        least = np.minimum(label[a], label[b])
        for end in (a, b):
            np.minimum.at(label, label[end], least)
            np.minimum.at(label, end, least)
        label = label[label]
        if np.array_equal(label, before):
            return len(np.unique(label))


def _holes(edges: int, holes: int) -> str:
    if not edges:
        return "closed: every edge has a face on both sides"
    return f"open: {edges:,} edges have a face on one side only, around {holes:,} holes or borders"


def _pictures(mesh: TriangleMesh) -> str:
    pictures = {p for part in mesh.parts for p in (part.picture, part.normals) if p is not None}
    size = sum(map(len, pictures)) / 1e6
    return f"pictures: {len(pictures)}, {size:.1f} MB" if pictures else "no pictures"


def _steepest_deg(made: Ground) -> float:
    across = np.abs(np.diff(made.heights, axis=1)).max()
    along = np.abs(np.diff(made.heights, axis=0)).max()
    return math.degrees(math.atan(max(across, along) / made.cell_m))


def _point(values: NDArray[np.float64]) -> str:
    return "[" + ", ".join(f"{value + 0.0:.3f}" for value in values) + "]"


def _quoted(file: str) -> str:
    return file if re.fullmatch(r"[\w./-]+", file) else "'" + file.replace("'", "''") + "'"


def _name(file: str) -> str:
    """Return a file's name as a valid scenario name."""
    word = re.sub(r"[^a-z0-9]+", "_", Path(file).stem.lower()).strip("_")
    return word if word[:1].isalpha() else f"world_{word}".rstrip("_")
