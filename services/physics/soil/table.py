# SPDX-License-Identifier: Apache-2.0
"""Table of sinkage and forces over load, slip and rut: what a run reads 400 times per second.

Entries have seven digits, so that the last bits of a machine's mathematical functions do not count.
"""

from bisect import bisect_right
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from groundlink.core.frames import Floats
from groundlink.world.soil import Soil

from .track import TrackSection, track_forces, track_sinkage
from .wheel import SoilForces, wheel_forces, wheel_sinkage

LOADS = np.geomspace(0.04, 6.0, 30)
"""In units of the nominal load."""

STEEP = np.geomspace(2e-3, 1.0, 20)
SLIPS = np.concatenate((-STEEP[::-1], [0.0], STEEP))

RUTS = np.linspace(0.0, 1.0, 5)
"""Depth of the rut in units of the sinkage in untouched soil at this load and slip."""


class SoilResponse(NamedTuple):
    """What the soil does to a wheel at a load, a slip and a rut."""

    sinkage_m: float
    thrust_n: float
    resistance_n: float
    side_n: float
    free_n: float
    """Thrust without slip."""

    most_n: float
    """Thrust of a wheel that spins in place."""


Row = tuple[float, float, float, float]


class SoilTable:
    """Responses of one soil to one kind of wheel or section of a track.

    Parameters
    ----------
    sinkage, forces
        at loads (N), slips and ruts (m) that broadcast against each other.
    load_n
        nominal load.
    """

    def __init__(
        self,
        sinkage: Callable[[Floats, Floats, Floats], Floats],
        forces: Callable[[Floats, Floats, Floats, Floats], SoilForces],
        load_n: float,
    ) -> None:
        loads = LOADS[:, None, None] * load_n
        slips = SLIPS[None, None, :]
        fresh = sinkage(loads, slips, np.zeros(()))
        ruts = RUTS[None, :, None] * fresh
        sunk = sinkage(loads, slips, ruts)
        found = forces(sunk, loads, slips, ruts)
        entries = np.stack([sunk, found.thrust_n, found.resistance_n, found.side_n], axis=-1)
        self._loads: list[float] = (LOADS * load_n).tolist()
        self._slips: list[float] = SLIPS.tolist()
        # Indices: load, rut, slip.
        self._rows: list[list[list[Row]]] = entries.astype(np.float32).astype(float).tolist()
        self._still = len(SLIPS) // 2

    def at(self, load_n: float, slip: float, rut: float = 0.0) -> SoilResponse:
        """Return the response at a load, a slip from -1 to 1, and a rut as a share from 0 to 1.

        Below the smallest load of the table all falls in proportion; beyond the largest it grows.
        """
        loads, slips = self._loads, self._slips
        scale = 1.0
        if load_n < loads[0]:
            scale, load_n = load_n / loads[0], loads[0]
        i = min(bisect_right(loads, load_n), len(loads) - 1) - 1
        a = (load_n - loads[i]) / (loads[i + 1] - loads[i])
        k = min(bisect_right(slips, slip), len(slips) - 1) - 1
        c = (slip - slips[k]) / (slips[k + 1] - slips[k])
        place = rut * (len(RUTS) - 1)
        j = min(int(place), len(RUTS) - 2)
        b = place - j
        still = self._still
        z = thrust = resistance = side = free = most = 0.0
        for rows, outer in ((self._rows[i], 1.0 - a), (self._rows[i + 1], a)):
            for row, weight in ((rows[j], outer * (1.0 - b)), (rows[j + 1], outer * b)):
                if weight == 0.0:
                    continue
                z0, thrust0, resistance0, side0 = row[k]
                z1, thrust1, resistance1, side1 = row[k + 1]
                low, high = weight * (1.0 - c), weight * c
                z += low * z0 + high * z1
                thrust += low * thrust0 + high * thrust1
                resistance += low * resistance0 + high * resistance1
                side += low * side0 + high * side1
                free += weight * row[still][1]
                most += weight * row[-1][1]
        return SoilResponse(
            scale * z,
            scale * thrust,
            scale * resistance,
            scale * side,
            scale * free,
            scale * most,
        )


@lru_cache(maxsize=64)
def wheel_table(soil: Soil, radius_m: float, width_m: float, load_n: float) -> SoilTable:
    """Return the table of a rigid wheel."""

    def sinkage(load: Floats, slip: Floats, rut: Floats) -> Floats:
        return wheel_sinkage(soil, radius_m, width_m, load, slip, rut)

    def forces(sunk: Floats, load: Floats, slip: Floats, rut: Floats) -> SoilForces:
        return wheel_forces(soil, radius_m, width_m, sunk, slip, rut)

    return SoilTable(sinkage, forces, load_n)


@lru_cache(maxsize=64)
def track_table(soil: Soil, track: TrackSection, load_n: float) -> SoilTable:
    """Return the table of a section of a track."""

    def sinkage(load: Floats, slip: Floats, rut: Floats) -> Floats:
        return track_sinkage(soil, track, load, slip, rut)

    def forces(sunk: Floats, load: Floats, slip: Floats, rut: Floats) -> SoilForces:
        return track_forces(soil, track, load, slip, rut)

    return SoilTable(sinkage, forces, load_n)
