# SPDX-License-Identifier: Apache-2.0
"""Noise and dropout of a LiDAR by intensity and range, as measured on a device.

The timing error of a receiver grows as its echo gets weaker: it goes with one over the square root
of the ratio of signal to noise (Skolnik, "Introduction to Radar Systems", on the accuracy of
range), and echoes near the threshold are lost at times. The received power is intensity over
distance squared, so a table by both covers it. Between the knots of the sheet's table values are
linear in both; beyond its ends they are those of the ends. The compiled pass reads the nearest of
128 by 128 cells, in even steps from 0 to the last knots.
"""

import ctypes
from ctypes import c_float, c_void_p

import numpy as np

from groundlink.core.frames import Floats
from groundlink.scenario.rotating_lidar import EchoBands

CELLS = 128
"""`BAND_CELLS` of `returns.h`."""


class _EchoBands(ctypes.Structure):
    """The structure `echo_bands` of `returns.h`."""

    _fields_ = (
        ("rows_per_intensity", c_float),
        ("columns_per_m", c_float),
        ("cells", c_void_p),
    )


class BandTable:
    """The table of a data sheet.

    Attributes
    ----------
    structure : ctypes.Structure
        Input of the compiled pass.
    """

    def __init__(self, bands: EchoBands) -> None:
        ends = [max(knots[-1], 1e-6) for knots in (bands.intensity, bands.range_m)]
        self._cells = np.zeros((CELLS, CELLS, 2), np.float32)
        for column, table in enumerate((bands.stddev_m, bands.dropout)):
            if table:
                self._cells[..., column] = _resampled(bands, np.array(table), ends)
        self.structure = _EchoBands(*((CELLS - 1) / end for end in ends), self._cells.ctypes.data)


def _resampled(bands: EchoBands, table: Floats, ends: list[float]) -> Floats:
    """Return a table at even steps from 0 to the ends, shape (128, 128)."""
    intensity, range_m = (np.linspace(0, end, CELLS) for end in ends)
    by_range = np.stack([np.interp(range_m, bands.range_m, row) for row in table])
    return np.stack([np.interp(intensity, bands.intensity, column) for column in by_range.T]).T
