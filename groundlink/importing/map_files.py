# SPDX-License-Identifier: Apache-2.0
"""Maps of nav2's map_server: a picture whose pixels are cells, and a YAML file about it.

`read_cells` gives the values that map_server publishes for the same files; `solids_of` builds a
world of them; `write` writes a map.
"""

from math import cos, sin
from pathlib import Path

import numpy as np
from msgspec.structs import asdict
from numpy.typing import NDArray

from groundlink.core.atomic_file import write_atomically
from groundlink.core.fields import Vector3
from groundlink.world import assets
from groundlink.world.mesh_asset import encode_mesh
from groundlink.world.occupancy import FREE, OCCUPIED, UNKNOWN, Cells, MapGrid, OccupancyMap
from groundlink.world.solids import Box, Mesh, Solid

from . import grayscale
from .file_errors import BadFile, reading
from .map_specs import MapServerYaml, OccupancyMapFile

FORMATS = (".pgm", ".png", ".bmp")

MAX_WALLS = 10_000
"""Walls of a world at most. Each is a body of its own in physics."""

_GRAYS = {OCCUPIED: 0, FREE: 254, UNKNOWN: 205}
"""Pixels of written maps, as map_saver writes them."""

_OCCUPIED_THRESH, _FREE_THRESH = 0.65, 0.196
"""They separate these pixels: 205 is 0.1961 dark."""


def grid_of(described: MapServerYaml, shape: tuple[int, ...]) -> MapGrid:
    """Return the grid of a map with this shape of cells."""
    x_m, y_m, yaw_rad = described.origin
    rows, columns = shape
    return MapGrid(described.resolution, x_m, y_m, yaw_rad, rows, columns)


def read_map(described: MapServerYaml, folder: Path) -> OccupancyMap:
    """Return the map that a YAML file of map_server describes.

    Parameters
    ----------
    folder
        folder of the YAML file.

    Raises
    ------
    BadFile
        when the picture cannot be used.
    """
    file = folder / described.image
    if file.suffix.lower() not in FORMATS:
        raise BadFile(f"{file}: unknown format; expected one of {', '.join(FORMATS)}")
    with reading(file, "picture"):
        grays, is_opaque = grayscale.read_levels(file)
    cells = cells_of(grays, described)
    if described.mode != "raw":
        cells[~is_opaque] = UNKNOWN
    return OccupancyMap(grid_of(described, cells.shape), cells)


def cells_of(grays: NDArray[np.uint8], described: MapServerYaml) -> Cells:
    """Return the values of cells: 0 to 100 percent occupied, -1 unknown.

    As in map_server, numbers are rounded to float32 before they are compared.
    """
    if described.mode == "raw":
        return np.where(grays <= OCCUPIED, grays, UNKNOWN).astype(np.int8)
    dark = grays.astype(np.float32) / np.float32(255)
    if not described.negate:
        dark = np.float32(1) - dark
    occupied, free = np.float32(described.occupied_thresh), np.float32(described.free_thresh)
    cells = np.full(grays.shape, UNKNOWN, np.int8)
    if described.mode == "scale":
        share = ((dark - free) / (occupied - free) * np.float32(100)).astype(np.float64)
        cells[:] = np.floor(share.clip(FREE, OCCUPIED) + 0.5)  # as C++ rounds
    cells[dark >= occupied] = OCCUPIED
    cells[dark <= free] = FREE
    return cells


def solids_of(found: OccupancyMap, spec: OccupancyMapFile, occupied_thresh: float) -> list[Solid]:
    """Return the solids of a map's world: one floor, then walls as few boxes.

    A cell is a wall if it is at least as occupied as the map's threshold. The floor lies below all
    known cells, also below walls; it is a mesh without thickness, since wheels feel the borders
    between boxes.

    Raises
    ------
    BadFile
        when no cell is known, or there are too many walls.
    """
    known, walls = found.cells != UNKNOWN, found.cells >= max(1, round(100 * occupied_thresh))
    if not known.any():
        raise BadFile("all cells of the map are unknown")
    boxes = rectangles(walls)
    if len(boxes) > MAX_WALLS:
        raise BadFile(
            f"the walls need {len(boxes)} boxes; expected at most {MAX_WALLS}. Fix: remove noise "
            "from the map, or use larger cells"
        )
    grid = found.grid
    turn = 0.0, 0.0, sin(grid.yaw_rad / 2), cos(grid.yaw_rad / 2)
    floor = Solid(
        name="map_floor",
        shape=_floor(rectangles(known), grid.resolution_m),
        material=spec.floor_material,
        position_m=(grid.x_m, grid.y_m, 0.0),
        orientation=turn,
        drivable=True,
    )
    return [
        floor,
        *(
            Solid(
                name=f"map_wall_{number}",
                shape=Box(size_m=(*_size_m(box, grid), spec.wall_height_m)),
                material=spec.wall_material,
                position_m=_middle_m(box, grid, spec.wall_height_m),
                orientation=turn,
            )
            for number, box in enumerate(boxes)
        ),
    ]


Rectangle = tuple[int, int, int, int]
"""First row, first column, and the row and column after the last."""


def rectangles(mask: NDArray[np.bool_]) -> list[Rectangle]:
    """Return rectangles that cover the marked cells, each cell once.

    Of two greedy coverings, along rows and along columns, the one with fewer rectangles counts.
    """
    by_rows = _rectangles(mask)
    by_columns = [(r0, c0, r1, c1) for c0, r0, c1, r1 in _rectangles(mask.T)]
    return min(by_rows, by_columns, key=len)


def _rectangles(mask: NDArray[np.bool_]) -> list[Rectangle]:
    """Return rectangles: each run of a row, extended over the next rows that have all of it."""
    left = np.array(mask, order="C")
    found = []
    for row in np.flatnonzero(left.any(axis=1)).tolist():
        edges = np.flatnonzero(np.diff(left[row], prepend=False, append=False))
        for first, last in edges.reshape(-1, 2).tolist():
            gaps = np.flatnonzero(~left[row:, first:last].all(axis=1))
            count = int(gaps[0]) if len(gaps) else len(left) - row
            left[row : row + count, first:last] = False
            found.append((row, first, row + count, last))
    return found


def _size_m(box: Rectangle, grid: MapGrid) -> tuple[float, float]:
    r0, c0, r1, c1 = box
    return (c1 - c0) * grid.resolution_m, (r1 - r0) * grid.resolution_m


def _middle_m(box: Rectangle, grid: MapGrid, height_m: float) -> Vector3:
    r0, c0, r1, c1 = box
    x, y = grid.resolution_m * (c0 + c1) / 2, grid.resolution_m * (r0 + r1) / 2
    c, s = cos(grid.yaw_rad), sin(grid.yaw_rad)
    return grid.x_m + c * x - s * y, grid.y_m + s * x + c * y, height_m / 2


def _floor(parts: list[Rectangle], resolution_m: float) -> Mesh:
    """Store a level mesh of rectangles, from the map's corner on, and return its shape."""
    r0, c0, r1, c1 = np.array(parts, np.float64).T * resolution_m
    level = np.zeros_like(r0)
    corners = [(c0, r0), (c1, r0), (c1, r1), (c0, r1)]
    vertices = np.stack([np.stack([x, y, level], axis=-1) for x, y in corners], axis=1)
    faces = np.array([(0, 1, 2), (0, 2, 3)]) + 4 * np.arange(len(parts))[:, None, None]
    flat = vertices.reshape(-1, 3).astype(np.float32)
    x_low, y_low, _ = flat.min(axis=0).tolist()
    x_high, y_high, _ = flat.max(axis=0).tolist()
    return Mesh(
        asset=assets.put(encode_mesh(flat, faces.reshape(-1, 3).astype(np.uint32))),
        low_m=(x_low, y_low, 0.0),
        high_m=(x_high, y_high, 0.0),
    )


def write(found: OccupancyMap, file: Path) -> Path:
    """Write a YAML file and a PGM picture beside it, which map_server loads; return the picture.

    Values from 1 to 99 are written as unknown.
    """
    grid, picture = found.grid, file.with_suffix(".pgm")
    grays = np.full(found.cells.shape, _GRAYS[UNKNOWN], np.uint8)
    for value, gray in _GRAYS.items():
        grays[found.cells == value] = gray
    with write_atomically(picture) as part:
        header = f"P5\n{grid.columns} {grid.rows}\n255\n"
        part.write_bytes(header.encode() + grays[::-1].tobytes())
    described = MapServerYaml(
        image=picture.name,
        resolution=grid.resolution_m,
        origin=(round(grid.x_m, 9), round(grid.y_m, 9), grid.yaw_rad),
        negate=0,
        occupied_thresh=_OCCUPIED_THRESH,
        free_thresh=_FREE_THRESH,
    )
    lines = [f"{key}: {_yaml(value)}\n" for key, value in asdict(described).items()]
    with write_atomically(file) as part:
        part.write_text("".join(lines), encoding="utf-8")
    return picture


def _yaml(value: object) -> str:
    return f"[{', '.join(map(repr, value))}]" if isinstance(value, tuple) else str(value)
