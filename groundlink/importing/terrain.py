# SPDX-License-Identifier: Apache-2.0
"""Terrain import: builds the assets of a terrain from its description.

Level areas are applied first, then roads. Material rules see the ground before roads.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.world import assets
from groundlink.world.terrain import Terrain, encode_grid

from . import grayscale, heightmaps, hills
from . import levels_and_roads as carving
from .file_errors import BadFile, Warn, reading
from .levels_and_roads import TerrainGrid
from .terrain_specs import GroundSpec, HeightmapFile, HillsTerrain, SurfaceMap, TerrainSpec

MAX_HEIGHT_M = 20_000.0
"""Maximum absolute height: twice the range on Earth."""

SQUARE = 1e-3
"""Allowed relative difference of a cell's sides."""


class BadTerrain(UserError):
    """A wrong description of terrain.

    Attributes
    ----------
    field
        the key at fault.
    problem
        the problem.
    """

    def __init__(self, field: str, problem: str) -> None:
        super().__init__(f"`{field}`: {problem}")
        self.field = field
        self.problem = problem


def build(spec: TerrainSpec, folder: Path, warn: Warn) -> Terrain:
    """Return resolved terrain and store its assets.

    Parameters
    ----------
    folder
        folder of the files in the description.
    warn
        receives warnings.

    Raises
    ------
    BadFile, BadTerrain
        when a file or a field is wrong.
    """
    if isinstance(spec, HillsTerrain):
        count = np.prod([size / spec.cell_m + 1 for size in spec.size_m])
        if count > grayscale.MAX_VALUES or min(spec.size_m) < spec.cell_m:
            raise BadTerrain(
                "size_m",
                f"{count:.0f} heights; expected 2 x 2 or more, and "
                f"{grayscale.MAX_VALUES // 10**6} million at most",
            )
        heights, cell_m = hills.heights(spec), spec.cell_m
    else:
        heights, cell_m = _from_file(spec, folder / spec.file, warn)
    rows, columns = heights.shape
    canvas = TerrainGrid(
        heights=heights,
        surface=np.zeros((rows - 1, columns - 1), np.uint8),
        cell_m=cell_m,
        x0_m=spec.at_m[0] - (columns - 1) * cell_m / 2,
        y0_m=spec.at_m[1] - (rows - 1) * cell_m / 2,
    )
    materials = _cover(canvas, spec, folder)
    low, high = float(canvas.heights.min()), float(canvas.heights.max())
    x_m, y_m, z_m = spec.at_m
    half_x, half_y = (columns - 1) * cell_m / 2, (rows - 1) * cell_m / 2
    return Terrain(
        heights=assets.put(encode_grid(canvas.heights)),
        surface=assets.put(encode_grid(canvas.surface)) if canvas.surface.any() else None,
        cell_m=cell_m,
        at_m=spec.at_m,
        low_m=(x_m - half_x, y_m - half_y, z_m + low),
        high_m=(x_m + half_x, y_m + half_y, z_m + high),
        materials=materials,
    )


def _from_file(spec: HeightmapFile, file: Path, warn: Warn) -> tuple[NDArray[np.float32], float]:
    """Return a file's heights with gaps filled, and the length of a cell."""
    found = heightmaps.read(file, warn)
    heights = _meters(found, spec, file, warn)
    cell_m = _cell_m(found, spec, file)
    if np.isinf(heights).any():
        raise BadFile(f"{file}: heights that are infinite; mend it or mark them as no data")
    gaps = int(np.isnan(heights).sum())
    if gaps > heights.size / 2:
        raise BadFile(f"{file}: {gaps} of {heights.size} places have no height; use a part of it")
    if gaps:
        warn(f"{file}: {gaps} places without a height were filled from the heights around them")
        heights = _filled(heights)
    if max(-heights.min(), heights.max()) > MAX_HEIGHT_M:
        raise BadFile(
            f"{file}: heights from {heights.min():g} to {heights.max():g}, which are no meters; "
            "is there a value that stands for no data?"
        )
    return heights, cell_m


def _meters(
    found: heightmaps.Heightmap, spec: HeightmapFile, file: Path, warn: Warn
) -> NDArray[np.float32]:
    """Return a map's values in meters, as a copy."""
    if found.full_scale is None:
        if spec.heights_m is not None:
            raise BadTerrain("heights_m", f"{file} is in meters already; leave this out")
        with np.errstate(over="ignore"):
            return found.values.astype(np.float32, order="C")
    if spec.heights_m is None:
        raise BadTerrain(
            "heights_m",
            f"is missing; give the two heights in meters that 0 and {found.full_scale} of "
            f"{file.name} stand for",
        )
    low, high = spec.heights_m
    if not low < high:
        raise BadTerrain("heights_m", "expected the lower height first")
    step_m = (high - low) / found.full_scale
    if found.full_scale == 255:
        warn(
            f"{file}: 8 bits a height: the ground has steps of {step_m:.3g} m; save it with 16 bits"
        )
    return (low + found.values * step_m).astype(np.float32)


def _cell_m(found: heightmaps.Heightmap, spec: HeightmapFile, file: Path) -> float:
    """Return the length of a cell: as given, or from the file."""
    rows, columns = found.values.shape
    if spec.size_m is not None:
        if spec.cell_m is not None:
            raise BadTerrain("size_m", "`cell_m` is given too; choose one")
        across, along = spec.size_m[0] / (columns - 1), spec.size_m[1] / (rows - 1)
        if abs(across - along) > SQUARE * across:
            raise BadTerrain(
                "size_m",
                f"{columns} x {rows} heights would have cells of {across:.4g} x {along:.4g} m; "
                "expected square ones",
            )
        return float(across)
    cell_m = spec.cell_m or found.cell_m
    if cell_m is None:
        raise BadTerrain(
            "cell_m", f"is missing, and {file.name} does not say it; add the meters of a cell"
        )
    return cell_m


def _filled(heights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return heights with gaps filled from a pyramid of 2 x 2 means."""
    missing = np.isnan(heights)
    if not missing.any():
        return heights
    rows, columns = heights.shape
    even = np.pad(heights, ((0, rows % 2), (0, columns % 2)), constant_values=np.nan)
    blocks = even.reshape(even.shape[0] // 2, 2, even.shape[1] // 2, 2)
    known = (~np.isnan(blocks)).sum(axis=(1, 3))
    sums = np.nansum(blocks, axis=(1, 3))
    coarse = np.full(known.shape, np.nan, np.float32)
    np.divide(sums, known, out=coarse, where=known > 0)
    coarse = _filled(coarse)
    wide = coarse.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns]
    return np.where(missing, wide, heights)


def _cover(canvas: TerrainGrid, spec: GroundSpec, folder: Path) -> tuple[str, ...]:
    """Apply materials, levels and roads to the grid; return material names by number."""
    materials = [spec.material]

    def number(material: str) -> int:
        if material not in materials:
            materials.append(material)
        return materials.index(material)

    if spec.surface is not None:
        numbers = np.array([number(name) for name in spec.surface.materials], np.uint8)
        canvas.surface[:] = numbers[_surface_map(spec.surface, folder, canvas.surface.shape)]
    if spec.where:
        slope_deg, middle_m = _slopes(canvas)
        for rule in spec.where:
            fits = (slope_deg >= rule.slope_deg[0]) & (slope_deg <= rule.slope_deg[1])
            fits &= (middle_m >= rule.height_m[0]) & (middle_m <= rule.height_m[1])
            canvas.surface[fits] = number(rule.material)
    for level in spec.levels:
        carving.add_level(canvas, level, None if level.material is None else number(level.material))
    for road in spec.roads:
        carving.add_road(canvas, road, number(road.material))
    return tuple(materials)


def _slopes(canvas: TerrainGrid) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return the slope in degrees and the height of each cell's middle."""
    a, b = canvas.heights[:-1, :-1], canvas.heights[:-1, 1:]
    c, d = canvas.heights[1:, :-1], canvas.heights[1:, 1:]
    across, along = (b - a + d - c) / 2, (c - a + d - b) / 2
    rise = np.hypot(across, along) / np.float32(canvas.cell_m)
    return np.degrees(np.arctan(rise)), (b + c) / 2


def _surface_map(surface: SurfaceMap, folder: Path, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a picture's numbers for cells, from south to north."""
    file = folder / surface.file
    with reading(file, "picture"):
        gray = grayscale.read(file)
    if gray.mode not in ("L", "P"):
        raise BadFile(f"{file}: a picture of mode {gray.mode}; expected 8-bit gray")
    rows, columns = shape
    if gray.values.shape not in (shape, (rows + 1, columns + 1)):
        raise BadFile(
            f"{file}: {gray.values.shape[1]} x {gray.values.shape[0]} pixels; expected one for "
            f"each cell, {columns} x {rows}, or for each height, {columns + 1} x {rows + 1}"
        )
    # With a pixel for each height, a cell takes the pixel of its south-west corner.
    numbers: NDArray[np.uint8] = gray.values[:rows, :columns]
    if numbers.max() >= len(surface.materials):
        raise BadFile(
            f"{file}: the number {numbers.max()}, but `materials` has {len(surface.materials)}, "
            "counted from 0"
        )
    return numbers
