# SPDX-License-Identifier: Apache-2.0
"""Table of sinkage and forces over load, slip and rut: what a run reads 400 times per second.

Entries have seven digits, so that the last bits of a machine's mathematical functions do not count.
"""

from collections.abc import Callable
from ctypes import Structure, byref, c_double, c_size_t, c_void_p
from functools import lru_cache

import numpy as np

from groundlink.core.frames import Floats
from groundlink.world.solids import Soil
from services.physics.dynamics.kernels import kernels

from .tire import InflatedTire, tire_forces, tire_sinkage
from .track import TrackSection, track_forces, track_sinkage
from .wheel import SoilForces, wheel_forces, wheel_sinkage

LOADS = np.geomspace(0.04, 6.0, 30)
"""In units of the nominal load."""

STEEP = np.geomspace(5e-4, 1.0, 24)
SLIPS = np.concatenate((-STEEP[::-1], [0.0], STEEP))

RUTS = np.linspace(0.0, 2.0, 7)
"""Depth of the rut in units of the sinkage in untouched soil at this load and slip."""


class SoilResponse(Structure):
    """What the soil does to a wheel at a load, a slip and a rut."""

    _fields_ = tuple(
        (name, c_double)
        for name in ("sinkage_m", "thrust_n", "resistance_n", "side_n", "free_n", "most_n")
    )
    sinkage_m: float
    thrust_n: float
    resistance_n: float
    side_n: float
    free_n: float
    """Thrust without slip."""

    most_n: float
    """Thrust of a wheel that spins in place."""


class SoilTable(Structure):
    """Responses of one soil to one kind of wheel or section of a track; `table.c` reads it.

    Parameters
    ----------
    sinkage, forces
        at loads (N), slips and ruts (m) that broadcast against each other.
    load_n
        nominal load.
    """

    _fields_ = (
        ("_loads", c_void_p),
        ("_slips", c_void_p),
        ("_rows", c_void_p),
        ("_load_count", c_size_t),
        ("_rut_count", c_size_t),
        ("_slip_count", c_size_t),
        ("_deepest_rut", c_double),
    )

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
        rows = np.stack([sunk, found.thrust_n, found.resistance_n, found.side_n], axis=-1)
        self._kept = loads.ravel(), SLIPS, rows.astype(np.float32).astype(np.float64)
        super().__init__(
            *(kept.ctypes.data for kept in self._kept), *(*rows.shape[:3], float(RUTS[-1]))
        )

    def at(self, load_n: float, slip: float, rut: float = 0.0) -> SoilResponse:
        """Return the response at a load, a slip from -1 to 1, and a rut in the unit of `RUTS`.

        Below the smallest load of the table all falls in proportion; beyond the largest it grows.
        """
        response = SoilResponse()
        kernels().soil_table_at(byref(self), load_n, slip, rut, byref(response))
        return response


@lru_cache(maxsize=64)
def wheel_table(soil: Soil, radius_m: float, width_m: float, load_n: float) -> SoilTable:
    """Return the table of a rigid wheel."""

    def sinkage(load: Floats, slip: Floats, rut: Floats) -> Floats:
        return wheel_sinkage(soil, radius_m, width_m, load, slip, rut)

    def forces(sunk: Floats, load: Floats, slip: Floats, rut: Floats) -> SoilForces:
        return wheel_forces(soil, radius_m, width_m, sunk, slip, rut)

    return SoilTable(sinkage, forces, load_n)


@lru_cache(maxsize=64)
def tire_table(soil: Soil, tire: InflatedTire, load_n: float) -> SoilTable:
    """Return the table of an inflated tire."""

    def sinkage(load: Floats, slip: Floats, rut: Floats) -> Floats:
        return tire_sinkage(soil, tire, load, slip, rut)

    def forces(sunk: Floats, load: Floats, slip: Floats, rut: Floats) -> SoilForces:
        return tire_forces(soil, tire, sunk, load, slip, rut)

    return SoilTable(sinkage, forces, load_n)


@lru_cache(maxsize=64)
def track_table(soil: Soil, track: TrackSection, load_n: float) -> SoilTable:
    """Return the table of a section of a track."""

    def sinkage(load: Floats, slip: Floats, rut: Floats) -> Floats:
        return track_sinkage(soil, track, load, slip, rut)

    def forces(sunk: Floats, load: Floats, slip: Floats, rut: Floats) -> SoilForces:
        return track_forces(soil, track, load, slip, rut)

    return SoilTable(sinkage, forces, load_n)
