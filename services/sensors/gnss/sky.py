# SPDX-License-Identifier: Apache-2.0
"""The satellites above an antenna, and what their geometry makes of a receiver's errors.

Rule: directions in, dilution out. Satellites stand still, and are seen or not: signals are neither
bent nor reflected, so tall walls take satellites away and add no detour (multipath).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats

WORST_CONDITION = 1e6
"""Of the normal matrix: beyond it, satellites are in a line or a cone and give no position."""


class Geometry(NamedTuple):
    """What the satellites in view are worth."""

    satellites: int
    dilution_enu: tuple[float, float, float]
    """Standard deviation of east, north and up, for ranges with errors of 1."""

    @property
    def horizontal_dilution(self) -> float:
        """HDOP."""
        east, north, _ = self.dilution_enu
        return float(np.hypot(east, north))


def directions(satellites_deg: Sequence[tuple[float, float]]) -> Floats:
    """Return unit vectors east, north, up, shape (3, satellites), of azimuths and elevations."""
    azimuths, elevations = np.radians(np.array(satellites_deg, np.float64).reshape(-1, 2)).T
    across = np.cos(elevations)
    return np.stack([across * np.sin(azimuths), across * np.cos(azimuths), np.sin(elevations)])


def geometry(towards: Floats, visible: NDArray[np.bool_]) -> Geometry | None:
    """Return the geometry of the visible satellites; None where they give no position.

    Position and receiver clock by least squares with equal weights: the covariance is the inverse
    of H^T H, with a row (east, north, up, 1) a satellite (Misra and Enge, "Global Positioning
    System", 2nd edition, section 6.1.2).

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
        when they give no position.
    """
    found = geometry(towards, np.ones(towards.shape[1], np.bool_))
    if found is None:
        raise UserError(
            "`satellites_deg`: these directions give no position even under the open sky; "
            "spread them over the sky"
        )
    return found
