# SPDX-License-Identifier: Apache-2.0
"""Global planner: the cheapest path through a grid, by scikit-image.

A cell costs more the nearer an obstacle is. Obstacles are those of the map, and points of scans
that the map lacks.
"""

import numpy as np
from occupancy_map import OccupancyMap
from poses import Floats
from scipy.ndimage import distance_transform_edt, uniform_filter1d
from skimage.graph import route_through_array

REMEMBERED_S = 5.0
"""How long an obstacle counts after it was last seen."""

CLEARANCE_M = 0.3
"""Distance over which the cost of an obstacle falls to 1/e."""

NARROW_COST = 50.0
"""Cost of a cell in which the robot can't turn on the spot, relative to open space."""

SMOOTHED_CELLS = 11


class Planner:
    """Plans paths in a map with obstacles that come and go.

    Parameters
    ----------
    inscribed_m, circumscribed_m
        radii of the robot: it never fits below the first, and always above the second.
    """

    def __init__(self, known: OccupancyMap, inscribed_m: float, circumscribed_m: float) -> None:
        self._known = known
        self._inscribed_m, self._circumscribed_m = inscribed_m, circumscribed_m
        self._seen_s = np.full(known.free.shape, -np.inf)

    def see(self, points: Floats, seconds: float) -> None:
        """Remember obstacles, shape (N, 2), that the map does not have."""
        self._seen_s[self._known.nearest_cells(points)] = seconds

    def plan(self, start: Floats, goal: Floats, seconds: float) -> Floats | None:
        """Return a path, shape (N, 2), from x and y to x and y; None if there is none."""
        blocked = ~self._known.free | (self._seen_s > seconds - REMEMBERED_S)
        distance_m = self._known.cell_m * distance_transform_edt(~blocked)
        cost = 1 + 10 * np.exp((self._circumscribed_m - distance_m) / CLEARANCE_M)
        cost[distance_m < self._circumscribed_m] = NARROW_COST
        cost[distance_m < self._inscribed_m] = -1  # impassable
        ends = np.rint(self._known.cells(np.array([start, goal])))
        try:
            cells, _ = route_through_array(cost, *ends.astype(int), geometric=True)
        except (ValueError, IndexError):  # cut off, or off the map
            return None
        path = self._known.centers(np.array(cells, np.float64))
        path[-1] = goal
        return uniform_filter1d(path, SMOOTHED_CELLS, axis=0, mode="nearest")
