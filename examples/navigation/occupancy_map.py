# SPDX-License-Identifier: Apache-2.0
"""Occupancy map: the files of nav2's `map_server` as arrays."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image
from poses import Floats


@dataclass(frozen=True)
class OccupancyMap:
    """Occupied and free cells; row 0 is the southern one, column 0 the western one."""

    occupied: NDArray[np.bool_]
    free: NDArray[np.bool_]
    """Known to be without an obstacle. A cell may be neither occupied nor free."""

    cell_m: float
    origin_m: Floats
    """x and y of the south-western corner."""

    def cells(self, points: Floats) -> Floats:
        """Return rows and columns of points, shape (N, 2); a whole number is a cell's center."""
        return ((points - self.origin_m) / self.cell_m - 0.5)[:, ::-1]

    def centers(self, cells: Floats) -> Floats:
        """Return x and y of rows and columns, shape (N, 2)."""
        return (cells[:, ::-1] + 0.5) * self.cell_m + self.origin_m

    def nearest_cells(self, points: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return rows and columns of the cells that points are in, without points off the map."""
        cells = np.rint(self.cells(points)).astype(np.intp)
        inside = np.all((cells >= 0) & (cells < self.free.shape), axis=1)
        return cells[inside, 0], cells[inside, 1]


def read_map(file: Path) -> OccupancyMap:
    """Read a map's YAML file, without rotation, and the image that it names."""
    described = yaml.safe_load(file.read_text(encoding="utf-8"))
    image = np.asarray(Image.open(file.parent / described["image"]).convert("L"))[::-1] / 255
    occupancy = image if described["negate"] else 1 - image
    return OccupancyMap(
        occupied=occupancy > described["occupied_thresh"],
        free=occupancy < described["free_thresh"],
        cell_m=described["resolution"],
        origin_m=np.array(described["origin"][:2]),
    )
