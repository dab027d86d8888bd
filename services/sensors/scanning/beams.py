# SPDX-License-Identifier: Apache-2.0
"""Beams of a LiDAR as rays: divergence and pointing errors.

The rays of a beam fill its width and height as the cells of a square grid, each with the same share
of the light. All rays of a beam have the same pointing error, which is drawn for every revolution;
the reported direction is the nominal one. A beam without divergence and error is one ray.
"""

import ctypes
import math
from typing import NamedTuple

import numpy as np

from groundlink.scenario.rotating_lidar import RotatingLidar
from services.sensors.rays.kernels import kernels
from services.sensors.rays.scene import Reals

from .draws import RevolutionDraws
from .sweep import Sweep


class Rays(NamedTuple):
    """Rays to cast; those of a beam are adjacent. C-contiguous."""

    origins_in_world: Reals
    """Shape (3, lasers, firings) or (3, lasers, firings, rays of a beam), meters."""

    directions_in_world: Reals
    """The same shape, unit vectors."""

    times: Reals
    """Without the first axis: 0..1 between the first and the last state of the revolution."""


class Beams:
    """The beams of a data sheet."""

    def __init__(self, spec: RotatingLidar, sweep: Sweep, draws: RevolutionDraws) -> None:
        self._sweep, self._draws = sweep, draws
        self._rays = spec.rays_per_beam
        self._stddevs = np.radians([spec.azimuth_stddev_deg, spec.elevation_stddev_deg])
        side = math.isqrt(spec.rays_per_beam)
        cells = (np.arange(side) + 0.5) / side - 0.5
        width, height = np.tan(1e-3 * np.array(spec.divergence_mrad))
        across, upward = np.meshgrid(width * cells, height * cells)
        self._within = np.stack([across.ravel(), upward.ravel()]).astype(np.float32)
        if self._rays == 1:
            self._within[:] = 0

    def rays(self, firings: range, tick: int) -> Rays:
        """Return the rays of firings of the sweep's present revolution.

        Parameters
        ----------
        firings : range
            All or some of the last `follow`.
        tick : int
            Keys the random numbers of the revolution.
        """
        sweep, asked = self._sweep, slice(firings.start, firings.stop)
        axes = sweep.origins_in_world, sweep.directions_in_world, sweep.times
        if self._rays == 1 and not self._stddevs.any():
            return Rays._make(np.ascontiguousarray(array[..., asked]) for array in axes)
        jitter = self._jitter(tick)
        shape = len(sweep.rings), len(firings), self._rays
        rays = Rays(*(np.empty((*axis, *shape), np.float32) for axis in ((3,), (3,), ())))
        kernels().groundlink_spread(
            *(ctypes.byref(sweep.head), firings.start, firings.stop),
            *(array.ctypes.data for array in (*sweep.poses, *axes)),
            *(self._rays, self._within.ctypes.data),
            None if jitter is None else jitter.ctypes.data,
            *(array.ctypes.data for array in rays),
        )
        return rays

    def _jitter(self, tick: int) -> Reals | None:
        """Return the errors of azimuth and elevation, shape (2, lasers, firings), radians."""
        if not self._stddevs.any():
            return None

        def draw(generator: np.random.Generator) -> Reals:
            shape = 2, *self._sweep.seconds.shape
            errors = generator.standard_normal(shape, np.float32) * self._stddevs[:, None, None]
            return errors.astype(np.float32)

        return self._draws.of("pointing", tick, draw)
