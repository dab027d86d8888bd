# SPDX-License-Identifier: Apache-2.0
"""Level areas and roads: edits of heights and materials in a terrain grid.

Each edit changes only the area around it, so a road costs its length and not the size of the map.
Parts beyond the map are cut off.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats

from .terrain_specs import LevelArea, Road

_Window = tuple[slice, slice]


@dataclass(frozen=True, eq=False)
class TerrainGrid:
    """Terrain grid under construction."""

    heights: NDArray[np.float32]
    """Shape (rows, columns), meters above the terrain's `at_m`."""

    surface: NDArray[np.uint8]
    """Shape (rows - 1, columns - 1)."""

    cell_m: float
    x0_m: float
    """Of the vertex [0, 0] in the world, as is `y0_m`."""

    y0_m: float

    def window(self, points: Floats, reach_m: float) -> _Window:
        """Return the rows and columns of all vertices within `reach_m` of points, shape (N, 2)."""
        low = (points.min(axis=0) - reach_m - (self.x0_m, self.y0_m)) / self.cell_m
        high = (points.max(axis=0) + reach_m - (self.x0_m, self.y0_m)) / self.cell_m
        rows, columns = self.heights.shape
        first_column, first_row = np.clip(np.floor(low), 0, (columns, rows)).astype(int)
        end_column, end_row = np.clip(np.ceil(high) + 1, 0, (columns, rows)).astype(int)
        return slice(first_row, end_row), slice(first_column, end_column)

    def places(self, window: _Window, *, cells: bool = False) -> Floats:
        """Return world positions of a window's vertices or cell centers, shape (R, C, 2)."""
        shape = self.surface.shape if cells else self.heights.shape
        row, column = (np.arange(n)[part] for n, part in zip(shape, window, strict=True))
        x, y = np.meshgrid(column + cells / 2, row + cells / 2)
        x_m: Floats = self.x0_m + x * self.cell_m
        y_m: Floats = self.y0_m + y * self.cell_m
        return np.stack([x_m, y_m], axis=-1)

    def heights_at(self, points: Floats) -> Floats:
        """Return the heights of the vertices nearest to points, shape (N, 2)."""
        steps = np.rint((points - (self.x0_m, self.y0_m)) / self.cell_m)
        rows, columns = self.heights.shape
        column, row = np.clip(steps, 0, (columns - 1, rows - 1)).astype(int).T
        heights: Floats = self.heights[row, column].astype(np.float64)
        return heights


def add_level(canvas: TerrainGrid, spec: LevelArea, number: int | None) -> None:
    """Add a level disc, of material `number` unless it is None."""
    middle = np.array([spec.at_m])
    window = canvas.window(middle, spec.radius_m + spec.shore_m)
    ground = canvas.heights[window]
    if not ground.size:
        return
    beyond_m = _length(canvas.places(window) - middle) - spec.radius_m
    height_m = spec.height_m
    if height_m is None:
        rim = ground[np.abs(beyond_m) <= canvas.cell_m]
        height_m = float((rim if rim.size else ground).min())
    canvas.heights[window] = _led_to(ground, height_m, beyond_m, spec.shore_m)
    if number is not None:
        on_it = _length(canvas.places(window, cells=True) - middle) <= spec.radius_m
        canvas.surface[window][on_it] = number


def add_road(canvas: TerrainGrid, spec: Road, number: int) -> None:
    """Add a road of material `number`."""
    line = np.array(spec.points_m, np.float64)
    ends_m = np.cumsum([0.0, *_length(np.diff(line, axis=0))])
    stations_m, profile_m = _profile(canvas, line, ends_m, spec.smooth_m)
    reach_m = spec.width_m / 2 + spec.shoulder_m
    whole = canvas.window(line, reach_m)
    away_m = np.full(canvas.heights.shape, np.inf)
    target_m = np.zeros(canvas.heights.shape)
    for i in range(len(line) - 1):
        window = canvas.window(line[i : i + 2], reach_m)
        if not canvas.heights[window].size:
            continue
        distance_m, share = _from_stretch(line[i], line[i + 1], canvas.places(window))
        nearer = distance_m < away_m[window]
        station_m = ends_m[i] + share * (ends_m[i + 1] - ends_m[i])
        target_m[window][nearer] = np.interp(station_m[nearer], stations_m, profile_m)
        away_m[window][nearer] = distance_m[nearer]
        distance_m, _ = _from_stretch(line[i], line[i + 1], canvas.places(window, cells=True))
        canvas.surface[window][distance_m <= spec.width_m / 2] = number
    canvas.heights[whole] = _led_to(
        canvas.heights[whole], target_m[whole], away_m[whole] - spec.width_m / 2, spec.shoulder_m
    )


def _profile(
    canvas: TerrainGrid, line: Floats, ends_m: Floats, smooth_m: float
) -> tuple[Floats, Floats]:
    """Return distances along a line and the smoothed heights there."""
    step_m = min(canvas.cell_m, smooth_m / 4)
    stations_m = np.linspace(0.0, ends_m[-1], max(2, int(np.ceil(ends_m[-1] / step_m)) + 1))
    places = np.stack([np.interp(stations_m, ends_m, line[:, axis]) for axis in (0, 1)], axis=-1)
    half = max(1, round(smooth_m / step_m / 2))
    ring = np.array_equal(line[0], line[-1])
    profile = np.pad(canvas.heights_at(places), 2 * half, mode="wrap" if ring else "edge")
    for _ in range(2):  # Two running means form a triangular filter without kinks.
        total = np.cumsum([0.0, *profile])
        profile = (total[2 * half + 1 :] - total[: -2 * half - 1]) / (2 * half + 1)
    return stations_m, profile


def _led_to(
    ground: NDArray[np.float32], target_m: Floats | float, beyond_m: Floats, over_m: float
) -> Floats:
    """Return heights blended from `target_m` (`beyond_m` <= 0) to `ground` (from `over_m` on)."""
    share = np.clip(beyond_m / max(over_m, 1e-9), 0, 1)
    share = share * share * (3 - 2 * share)
    return target_m * (1 - share) + ground * share


def _from_stretch(first: Floats, last: Floats, places: Floats) -> tuple[Floats, Floats]:
    """Return the distance of points to a line segment, and their position along it, 0..1."""
    along = last - first
    share = (places - first) @ along / max(float(along @ along), 1e-12)
    share = np.clip(share, 0, 1)
    return _length(places - first - share[..., None] * along), share


def _length(vectors: Floats) -> Floats:
    """Return the lengths of vectors, shape (..., 2)."""
    return np.hypot(vectors[..., 0], vectors[..., 1])
