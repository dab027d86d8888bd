# SPDX-License-Identifier: Apache-2.0
"""Satellite geometry above an antenna, and its dilution of precision.

Satellites do not move and are either visible or hidden. Signals are neither refracted nor
reflected, so tall walls hide satellites but cause no multipath.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats

WORST_CONDITION = 1e6
"""Condition number of the normal matrix. Above it, satellites lie on a line or a cone and give no
position."""


class Geometry(NamedTuple):
    """Geometry of the visible satellites."""

    satellites: int
    dilution_enu: tuple[float, float, float]
    """Standard deviation of east, north and up, for range errors with a standard deviation of 1."""

    @property
    def horizontal_dilution(self) -> float:
        """Horizontal dilution of precision (HDOP)."""
        east, north, _ = self.dilution_enu
        return float(np.hypot(east, north))


def directions(satellites_deg: Sequence[tuple[float, float]]) -> Floats:
    """Return unit vectors east, north, up, shape (3, satellites), from azimuths and elevations."""
    azimuths, elevations = np.radians(np.array(satellites_deg, np.float64).reshape(-1, 2)).T
    across = np.cos(elevations)
    return np.stack([across * np.sin(azimuths), across * np.cos(azimuths), np.sin(elevations)])


def geometry(towards: Floats, visible: NDArray[np.bool_]) -> Geometry | None:
    """Return the geometry of the visible satellites; None if they give no position.

    Position and receiver clock are estimated by least squares with equal weights. The covariance is
    the inverse of H^T H, with one row (east, north, up, 1) per satellite (Misra and Enge, "Global
    Positioning System", 2nd edition, section 6.1.2).

    Parameters
    ----------
    towards : shape (3, satellites)
    visible : shape (satellites,)
    """
    seen = towards[:, visible]
    rows = np.vstack([seen, np.ones(seen.shape[1])]).T
    normal = rows.T @ rows
    if len(rows) < 4 or np.linalg.cond(normal) > WORST_CONDITION:
        return None
    east, north, up, _ = np.sqrt(np.diag(np.linalg.inv(normal))).tolist()
    return Geometry(len(rows), (east, north, up))


def open_sky(towards: Floats) -> Geometry:
    """Return the geometry of all satellites.

    Raises
    ------
    UserError
        when the satellites give no position.
    """
    found = geometry(towards, np.ones(towards.shape[1], np.bool_))
    if found is None:
        raise UserError(
            "`satellites_deg`: these directions give no position even under the open sky; "
            "spread them over the sky"
        )
    return found
