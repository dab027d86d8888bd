# SPDX-License-Identifier: Apache-2.0
"""Depth of field: what is nearer or farther than the sharp distance is blurred.

Rule: a thin lens (Potmesil and Chakravarty 1981, "A lens and aperture camera model for synthetic
image generation"): a point at z has a circle of confusion of f A |1/z - 1/z_f| pixels in diameter.
Pictures of several blurs are mixed for the one between them; the seam between a sharp thing and a
blurred one behind it is not solved, and blurs of more than `DIAMETERS` has are not made.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.rendering.gl.target import Frame

DIAMETERS = (0.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Of the circles of confusion that pictures are blurred for, pixels."""

NEAREST_M = 1e-3


class Focus:
    """The focus of one lens.

    Parameters
    ----------
    spread_px_m : float
        Focal length in pixels by aperture in metres.
    focus_m : float
    """

    def __init__(self, spread_px_m: float, focus_m: float) -> None:
        self._spread_px_m, self._focus_m = spread_px_m, focus_m

    def diameters(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the circle of confusion of each depth, pixels."""
        nearer = 1 / np.maximum(depth_m, NEAREST_M) - 1 / self._focus_m
        return np.asarray(np.abs(self._spread_px_m * nearer), np.float32)

    def seen(self, frame: Frame) -> NDArray[np.uint8]:
        """Return the colours of a frame, blurred by its depth."""
        squared = np.minimum(self.diameters(frame.depth_m), DIAMETERS[-1]) ** 2
        largest = float(squared.max())
        made = frame.colour
        for low, high in pairwise(DIAMETERS):
            if low**2 >= largest:
                break
            # A disc's variance along a line is a sixteenth of its squared diameter, and variances
            # of pictures that are mixed add up by their shares.
            more = cv2.GaussianBlur(frame.colour, (0, 0), high / 4)
            share = np.clip((squared - low**2) / (high**2 - low**2), 0, 1)
            made = np.asarray(cv2.blendLinear(made, more, 1 - share, share), np.uint8)
        return made
