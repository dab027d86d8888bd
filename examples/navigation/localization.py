# SPDX-License-Identifier: Apache-2.0
"""Localization: matches laser scans to an occupancy map.

The pose minimizes the distances of the scan's points to occupied cells (likelihood field).
Distances come from SciPy's Euclidean distance transform, the minimum from its robust least squares.
"""

import numpy as np
from occupancy_map import OccupancyMap
from poses import Floats, compose, inverse, transformed
from scipy.ndimage import distance_transform_edt, map_coordinates
from scipy.optimize import least_squares

FAR_M = 0.5
"""Largest distance that counts. A point farther from the map belongs to an unknown obstacle."""

NOISE_M = 0.05
"""Distances beyond this weigh less and less."""

POINTS = 200
"""Points of a scan that are matched, evenly chosen."""


class Localizer:
    """Estimates the robot's pose in the map.

    Parameters
    ----------
    map_from_base
        where the robot is at its first scan, to about 0.3 m and 15 degrees.
    """

    def __init__(self, known: OccupancyMap, map_from_base: Floats) -> None:
        self._known = known
        self._map_from_base = map_from_base
        self._odom_from_base: Floats | None = None
        distance_m = known.cell_m * distance_transform_edt(~known.occupied)
        self._distance_m = np.minimum(distance_m, FAR_M)

    def locate(self, points: Floats, odom_from_base: Floats) -> Floats:
        """Return map_from_base at a scan, from its points in the base frame and the odometry."""
        if self._odom_from_base is not None:
            motion = compose(inverse(self._odom_from_base), odom_from_base)
            self._map_from_base = compose(self._map_from_base, motion)
        self._odom_from_base = odom_from_base
        if len(points):
            chosen = points[:: max(len(points) // POINTS, 1)]
            self._map_from_base = least_squares(
                lambda pose: self.distances(transformed(pose, chosen)),
                self._map_from_base,
                loss="cauchy",
                f_scale=NOISE_M,
                max_nfev=20,
            ).x
        return self._map_from_base

    def distances(self, points: Floats) -> Floats:
        """Return distances (m, at most `FAR_M`) of points in the map to occupied cells."""
        cells = self._known.cells(points).T
        return map_coordinates(self._distance_m, cells, order=1, mode="constant", cval=FAR_M)
