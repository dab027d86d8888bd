# SPDX-License-Identifier: Apache-2.0
"""Sweep whose directions differ from revolution to revolution: patterns that do not repeat."""

from abc import abstractmethod

import numpy as np

from groundlink.core.frames import Floats
from groundlink.scenario.rotating_lidar import RotatingLidar

from .sweep import Sweep


class PatternSweep(Sweep):
    """The rays of a data sheet with a pattern.

    Parameters
    ----------
    spec : RotatingLidar
        `elevations_deg` are the beams' offsets in their fan. A revolution is a period of the
        device's messages.
    """

    def __init__(self, spec: RotatingLidar) -> None:
        super().__init__(spec)
        self.offsets_rad: Floats = np.radians(spec.elevations_deg)[self.rings, None]
        self._period_s = 1 / spec.rotation_rate_hz
        self._aimed = -1

    def aim(self, revolution: int) -> None:
        """Point the rays at the directions of a revolution."""
        if self._aimed == revolution:
            return
        self._aimed = revolution
        directions = self.directions(revolution * self._period_s + self.seconds)
        # A new array: scans of the revolution before may still be read.
        self.directions_in_sensor = directions.astype(np.float32)
        self.head.directions_in_sensor = self.directions_in_sensor.ctypes.data

    @abstractmethod
    def directions(self, seconds: Floats) -> Floats:
        """Return unit vectors of beams at instants of a run, shape (3, lasers, firings).

        Parameters
        ----------
        seconds : float64 array, shape (lasers, firings)
        """
