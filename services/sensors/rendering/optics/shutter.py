# SPDX-License-Identifier: Apache-2.0
"""Shutter: when rows are exposed, and one picture made of several drawn during the exposure.

A picture drawn at one instant represents an equal part of the time from the first row's beginning
to the last row's end. A row is the mean of linear light over its exposure. A row with an exposure
of zero is that of the nearest drawn picture.
"""

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.scenario.cameras import Imager

LIGHT = (np.arange(256) ** 2 / 255**2).astype(np.float32)
"""Linear light of a coded value: its square, because the renderer codes with the square root."""

INSTANT_S = 1e-9
"""Exposure in nanoseconds that stands for zero, so that shares of it exist."""


class View(NamedTuple):
    """Contribution of one drawn picture."""

    offset_nanos: int
    """Instant of the drawing, after the beginning, nanoseconds."""

    rows: slice
    """Rows to which it contributes."""

    shares: NDArray[np.float32]
    """Share of the light of each of these rows, shape (rows, 1, 1)."""


class Shutter:
    """The exposures of one camera's pictures.

    Parameters
    ----------
    spec : Imager
    height : int
        Number of rows.

    Attributes
    ----------
    span_nanos : int
        Time from the beginning of the first row to the end of the last one.
    middle_nanos : int
        Half of that.
    """

    def __init__(self, spec: Imager, height: int) -> None:
        self.span_nanos = round(spec.span_s * NANOS)
        self.middle_nanos = round(0.5 * spec.span_s * NANOS)
        self._views = []
        for number, shares in enumerate(weights(spec, height)):
            lit = np.flatnonzero(shares)
            if len(lit):
                rows = slice(int(lit[0]), int(lit[-1]) + 1)
                offset_s = (number + 0.5) / spec.poses * spec.span_s
                self._views.append(View(round(offset_s * NANOS), rows, shares[rows, None, None]))

    @property
    def is_still(self) -> bool:
        """Whether one drawing, in the middle of the exposure, suffices."""
        return len(self._views) == 1

    def exposed(self, drawn: Callable[[int], NDArray[np.uint8]]) -> NDArray[np.uint8]:
        """Return one picture, (height, width, 3), from those that `drawn` returns for offsets.

        Offsets are in nanoseconds after the beginning.
        """
        if len(self._views) == 1:
            return drawn(self._views[0].offset_nanos)
        light = np.zeros(0, np.float32)
        for offset_nanos, rows, shares in self._views:
            picture = drawn(offset_nanos)
            if not len(light):
                light = np.zeros(picture.shape, np.float32)
            light[rows] += cv2.LUT(picture[rows], LIGHT) * shares
        return np.asarray(np.rint(255 * np.sqrt(light)), np.uint8)


def weights(spec: Imager, height: int) -> NDArray[np.float32]:
    """Return each drawn picture's share of each row, shape (poses, height); rows sum to 1."""
    exposure_s, span_s = max(spec.exposure_s, INSTANT_S), max(spec.span_s, INSTANT_S)
    begins_s = np.linspace(0.0, span_s - exposure_s, height)
    edges_s = np.linspace(0.0, span_s, spec.poses + 1)[:, None]
    covered_s = np.clip(edges_s, begins_s, begins_s + exposure_s)
    return (np.diff(covered_s, axis=0) / exposure_s).astype(np.float32)
