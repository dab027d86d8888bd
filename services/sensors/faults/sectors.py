# SPDX-License-Identifier: Apache-2.0
"""Sectors of a turning head: which azimuths a covered sector holds."""

import math

import numpy as np
from numpy.typing import NDArray


def within(
    azimuth_rad: NDArray[np.floating], begin_rad: float, width_rad: float
) -> NDArray[np.bool_]:
    """Return which azimuths are in the sector that goes counter-clockwise from `begin_rad`."""
    inside: NDArray[np.bool_] = (azimuth_rad - begin_rad) % (2 * math.pi) <= width_rad
    return inside
