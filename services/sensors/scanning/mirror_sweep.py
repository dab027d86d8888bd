# SPDX-License-Identifier: Apache-2.0
"""Sweep of a fast turning mirror whose tilt changes slowly: no two revolutions are alike.

A fan of beams, fixed in the device, meets the mirror. The middle of the fan leaves at the mirror's
azimuth and at the elevation of its tilt, which moves evenly down and up again. The other beams turn
around it with the mirror: a beam that is `offset` above the middle when the mirror looks where it
started is `offset` below it half a turn later. In between, it is half as far aside.

Source: the beginning of the table of angles that Livox publishes for the Mid-360 (`scan_mode` of
livox_laser_simulation, MIT), from which these shapes were read.
"""

import numpy as np

from groundlink.core.frames import Floats
from groundlink.scenario.rotating_lidar import RotatingLidar, TurningMirror

from .pattern_sweep import PatternSweep
from .sweep import SIGNS, unit_vectors

ASIDE = 0.5
"""Deviation of a beam to the side, as a share of that in elevation. In the table 0.53."""


class MirrorSweep(PatternSweep):
    """The rays of a data sheet with a mirror."""

    def __init__(self, spec: RotatingLidar, mirror: TurningMirror) -> None:
        super().__init__(spec)
        self._mirror, self._sign = mirror, SIGNS[spec.rotation]
        self._start_rad = np.radians(spec.start_deg)
        self.aim(0)

    def directions(self, seconds: Floats) -> Floats:
        """Return unit vectors of beams at instants of a run, shape (3, lasers, firings)."""
        turned = 2 * np.pi * (self._mirror.turns_per_s * seconds % 1)
        share = 2 * np.abs((seconds / self._mirror.tilt_period_s + 0.5) % 1 - 0.5)
        highest_deg, lowest_deg = self._mirror.elevations_deg
        middle = np.radians(highest_deg + (lowest_deg - highest_deg) * share)
        elevation = middle + self.offsets_rad * np.cos(turned)
        aside = ASIDE * self.offsets_rad * np.sin(turned) / np.cos(elevation)
        return unit_vectors(self._start_rad + self._sign * (turned + aside), elevation)
