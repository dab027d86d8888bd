# SPDX-License-Identifier: Apache-2.0
"""Light of other surfaces in a beam: mixed pixels at edges, and blooming of retroreflectors.

Mixed pixels. A beam of one ray has the footprint of its divergence across. Where the surfaces that
two neighboring firings of a laser hit do not continue into each other, an edge lies anywhere
between the two, drawn anew in each revolution. The part of the footprint beyond it lies on the
other surface. Surfaces closer than half a pulse's length give one return between them, at the mean
range weighted by power (Hebert and Krotkov 1992, "3D measurements from imaging laser radars: how
good are they?"); others two, of which the device reports what `returns` says. Before the sky a beam
loses light. Edges between lasers need `rays_per_beam`.

Blooming. Optics spread a small share of a beam's light beside its footprint. Of a retroreflector,
some hundred times brighter than a white surface, that share is enough for a return: beams that miss
it by the angle a beyond the footprint see it with `share` exp(-a / width) of its light, if that is
the stronger return. The exponential is our own estimate of the spread.

Firings before and after the present ones of the same revolution are needed for both; the first and
the last of a revolution have neighbors on one side.
"""

import ctypes
import math
from ctypes import c_float, c_int32, c_void_p

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.world.solids import RETROREFLECTION
from services.sensors.rays.scene import Numbers

ECHO_BYTES = 24
"""Size of the structure `echo` of `returns.h`."""

DARKEST = 1.0
"""Light beside a footprint, in percent of a white surface's, that is looked for at least."""


class _Blooming(ctypes.Structure):
    """The structure `blooming` of `returns.h`."""

    _fields_ = (
        *((name, c_float) for name in ("share", "per_rad", "footprint", "limit")),
        ("firings", c_int32),
        *((name, c_void_p) for name in ("first", "other", "shift")),
    )


class StrayLight:
    """Stray light of a data sheet.

    Parameters
    ----------
    spec : RotatingLidar
    rings : uint16 array
        Numbers from below of the lasers, in the order of firing.

    Attributes
    ----------
    reach : float
        Half width of a footprint in firings, at most 1; 0 without mixed pixels.
    blooming : ctypes.Structure or None
        Input of the compiled pass.
    neighbors : int
        Firings before and after a firing whose hits it depends on.
    """

    def __init__(self, spec: RotatingLidar, rings: NDArray[np.uint16]) -> None:
        step_rad = math.tau / spec.firings_per_revolution
        across_rad = 1e-3 * spec.divergence_mrad[0]
        self.reach = min(1.0, across_rad / 2 / step_rad) if spec.mixed_pixels else 0.0
        self.neighbors = 1 if spec.mixed_pixels else 0
        self.blooming: _Blooming | None = None
        if spec.blooming is None:
            return
        width_rad = 1e-3 * spec.blooming.width_mrad
        footprint_rad = 1e-3 * max(spec.divergence_mrad) / 2
        most = spec.blooming.share * 100 * RETROREFLECTION
        limit_rad = footprint_rad + width_rad * max(0.0, math.log(max(most / DARKEST, 1e-9)))
        elevation = np.radians(spec.elevations_deg)[rings]
        ahead = _ahead_firings(spec)[rings]
        near = np.abs(elevation[:, None] - elevation) <= limit_rad
        pairs = [np.flatnonzero(row) for row in near]
        shift = np.rint(ahead[:, None] - ahead).astype(np.int32)
        self._first: Numbers = np.cumsum([0, *map(len, pairs)], dtype=np.int32)
        self._other: Numbers = np.concatenate(pairs).astype(np.int32)
        self._shift: Numbers = shift[near]
        across = limit_rad / max(math.cos(np.abs(elevation).max()), 0.1)
        firings = math.ceil(across / step_rad) + 1
        self.neighbors = max(self.neighbors, firings + int(np.abs(self._shift).max()))
        self.blooming = _Blooming(
            *(spec.blooming.share, 1 / width_rad, footprint_rad, limit_rad, firings),
            *(array.ctypes.data for array in (self._first, self._other, self._shift)),
        )


def _ahead_firings(spec: RotatingLidar) -> Floats:
    """Return by how many firings each laser's azimuth is ahead of its firing's, in ring order."""
    none = (0.0,) * len(spec.elevations_deg)
    offsets = np.array(spec.azimuth_offsets_deg or none) * spec.firings_per_revolution / 360
    late = 1e-6 * np.array(spec.laser_times_us or none)
    ahead: Floats = offsets + late * spec.rotation_rate_hz * spec.firings_per_revolution
    return ahead
