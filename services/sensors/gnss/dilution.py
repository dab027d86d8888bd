# SPDX-License-Identifier: Apache-2.0
"""Dilution of precision: from directions to satellites to the accuracy of a position."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats

WORST_CONDITION = 1e6
"""Condition number of the normal matrix. Above it, satellites lie on a line or a cone and give no
position."""


class Geometry(NamedTuple):
    """Geometry of the satellites in use."""

    satellites: int
    dilution_enu: tuple[float, float, float]
    """Standard deviation of east, north and up, for range errors with a standard deviation of 1."""

    time_dilution: float
    """The same of the receiver clock, as a length."""

    estimator: Floats
    """Shape (4, satellites): errors of east, north, up and clock for range errors, in meters."""

    @property
    def horizontal_dilution(self) -> float:
        """Horizontal dilution of precision (HDOP)."""
        east, north, _ = self.dilution_enu
        return float(np.hypot(east, north))


def geometry(towards: Floats, used: NDArray[np.bool_]) -> Geometry | None:
    """Return the geometry of the satellites in use; None if they give no position.

    Position and receiver clock are estimated by least squares with equal weights. The covariance is
    the inverse of H^T H, with one row (east, north, up, 1) per satellite (Misra and Enge, "Global
    Positioning System", 2nd edition, section 6.1.2).

    Parameters
    ----------
    towards : shape (3, satellites)
    used : shape (satellites,)
    """
    seen = towards[:, used]
    rows = np.vstack([seen, np.ones(seen.shape[1])]).T
    normal = rows.T @ rows
    if len(rows) < 4 or np.linalg.cond(normal) > WORST_CONDITION:
        return None
    covariance = np.linalg.inv(normal)
    east, north, up, time = np.sqrt(np.diag(covariance)).tolist()
    # A satellite that is farther than assumed shifts the position away from it.
    estimator = covariance @ rows.T * [[-1.0], [-1.0], [-1.0], [1.0]]
    return Geometry(len(rows), (east, north, up), time, estimator)
