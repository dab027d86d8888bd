# SPDX-License-Identifier: Apache-2.0
"""Depth of field: blur what is nearer or farther than the focus distance.

Thin lens model (Potmesil and Chakravarty 1981, "A lens and aperture camera model for synthetic
image generation"): a point at depth z has a circle of confusion of f A |1/z - 1/z_f| pixels in
diameter. Blurs between those of `DIAMETERS` are mixed from two pictures. Larger blurs are not
modeled, nor is the seam between a sharp object and a blurred one behind it.
"""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from services.sensors.rendering.gl.target import Frame

DIAMETERS = (0.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Diameters of the circles of confusion for which pictures are blurred, pixels."""

NEAREST_M = 1e-3


class Focus:
    """The focus of one lens.

    Parameters
    ----------
    spread_px_m : float
        Focal length in pixels times aperture in meters.
    focus_m : float
    """

    def __init__(self, spread_px_m: float, focus_m: float) -> None:
        self._spread_px_m, self._focus_m = spread_px_m, focus_m

    def diameters(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the diameter of the circle of confusion at each depth, pixels."""
        nearer = 1 / np.maximum(depth_m, NEAREST_M) - 1 / self._focus_m
        return np.asarray(np.abs(self._spread_px_m * nearer), np.float32)

    def seen(self, frame: Frame) -> NDArray[np.uint8]:
        """Return the colors of a frame, blurred by depth."""
        squared = np.minimum(self.diameters(frame.depth_m), DIAMETERS[-1]) ** 2
        largest = float(squared.max())
        made = frame.color
        for low, high in pairwise(DIAMETERS):
            if low**2 >= largest:
                break
            # The variance of a disc along a line is a sixteenth of its squared diameter. Variances
            # of mixed pictures add up in proportion.
            more = cv2.GaussianBlur(frame.color, (0, 0), high / 4)
            share = np.clip((squared - low**2) / (high**2 - low**2), 0, 1)
            made = np.asarray(cv2.blendLinear(made, more, 1 - share, share), np.uint8)
        return made
