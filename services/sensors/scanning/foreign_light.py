# SPDX-License-Identifier: Apache-2.0
"""Light that is not a device's own: of the sun, and pulses of other LiDARs.

Sunlight. Photons of the background arrive at random, so the noise of a receiver grows with the
square root of its light. A surface of reflectivity rho that the sun hits at the angle s has the
background rho cos(s), 1 for white (Lambert). In units of the noise in the dark, the noise is

    n = sqrt(1 + k rho cos(s))        k = (1 / reach_share^4 - 1) / rho_0

k is such that a surface of `full_range_reflectivity` rho_0 in perpendicular sunlight is detected up
to `reach_share` of the largest range: the threshold follows the noise (constant false-alarm rate),
and power falls with the square of the range. Light that the optics scatter from the sun's direction
adds (`glare_deg` / angle)^2, as Stiles and Holladay found for eyes (1929), up to the sun's edge.

Noise alone passes a threshold of T times the noise on average 1 / (2 sqrt(3) tau) exp(-T^2 / 2)
times a second, at any time (Rice 1944, "Mathematical analysis of random noise", with a band of one
over twice the pulse's length tau; used for LiDARs since the RCA Electro-Optics Handbook, 1974).
T follows from `false_share`, the share of shots in which that happens within the largest range. An
echo of power P over the threshold in the dark, P_0, gets in addition the noise

    sigma = c tau / 2 / sqrt(2) sqrt(n^2 - 1) P_0 / (T P)

(Skolnik, "Introduction to Radar Systems", on the accuracy of range, with a rise time tau).

Crosstalk. A pulse of another LiDAR that lies on the surface at which a ray looks is received like
the own echo, at a time that has nothing to do with the own pulse: at any range (Popko, Gaylord and
Valenta 2020, "Geometric approximation model of inter-lidar interference"). It is between 0 and
twice as bright, our own estimate. Rays that meet nothing get none.

Not modeled: shadows (a surface that faces the sun is lit), light of the sky, direct sight of
another LiDAR's window.
"""

import ctypes
import math
from ctypes import c_float, c_void_p

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.rotating_lidar import LIGHT_MPS, RotatingLidar
from groundlink.scenario.schema import Scenario
from groundlink.world.weather import Sun

SUN_RADIUS_RAD = math.radians(0.2666)
BRIGHTEST = 2.0
"""Light of another LiDAR's pulse at most, in units of the own echo."""


FALSE_RETURN = np.dtype([("beam", "<i4"), ("range", "<f4"), ("gain", "<f4")])
"""The structure `false_return` of `returns.h`."""

END = np.array([(2**31 - 1, 0, 0)], FALSE_RETURN)
"""What false returns of a revolution end with."""

FalseReturns = NDArray[np.void]


class _Sunlight(ctypes.Structure):
    """The structure `sunlight` of `returns.h`."""

    _fields_ = (
        ("towards", c_float * 3),
        *((name, c_float) for name in ("noise", "glare", "least_chord", "spread")),
        *((name, c_void_p) for name in ("lit", "scattered")),
    )


class ForeignLight:
    """Foreign light of a data sheet.

    Parameters
    ----------
    spec : RotatingLidar
    sun : Sun or None
        None where lamps light the world.
    others : int
        Other LiDARs in the world.

    Attributes
    ----------
    sunlight : ctypes.Structure or None
        Input of the compiled pass.
    """

    def __init__(self, spec: RotatingLidar, sun: Sun | None, others: int) -> None:
        self._beams = len(spec.elevations_deg) * spec.firings_in_view
        self._span_m = spec.min_range_m, spec.max_range_m
        self._crosstalk = 1 - (1 - spec.crosstalk_share) ** others
        self._noise = spec.sun.false_share if spec.sun and sun else 0.0
        self.sunlight: _Sunlight | None = None
        if spec.sun and sun:
            self._of_rays = np.empty((2, self._beams * spec.rays_per_beam), np.float32)
            self.sunlight = _Sunlight(
                (c_float * 3)(*sun.towards),
                (spec.sun.reach_share**-4 - 1) / spec.full_range_reflectivity,
                *(math.radians(spec.sun.glare_deg) ** 2, SUN_RADIUS_RAD**2),
                spec.cell_m / math.sqrt(2) / threshold(spec, spec.sun.false_share),
                *(row.ctypes.data for row in self._of_rays),
            )

    @property
    def share(self) -> float:
        """Share of shots with a false return."""
        return 1 - (1 - self._crosstalk) * (1 - self._noise)

    def false_returns(self, source: np.random.Generator) -> FalseReturns:
        """Draw those of a revolution: `FALSE_RETURN` records in the order of beams, with an end."""
        mean = self._beams * self.share
        most = math.ceil(mean + 10 * math.sqrt(mean) + 10)
        gap, kind, place, light = source.random((4, most))
        # Beams between two false returns have the geometric distribution.
        skipped = np.log1p(-gap) // math.log1p(-self.share) if self.share < 1 else np.zeros(most)
        beams = np.cumsum(skipped + 1) - 1
        count = int(np.searchsorted(beams, self._beams))
        nearest_m, farthest_m = self._span_m
        made = np.zeros(count + 1, FALSE_RETURN)
        made["beam"][:count], made["beam"][count] = beams[:count], END["beam"][0]
        made["range"][:count] = (nearest_m + (farthest_m - nearest_m) * place)[:count]
        brightness = np.where(kind * self.share < self._crosstalk, BRIGHTEST * light, 0)
        made["gain"][:count] = brightness[:count]
        return made


def foreign_light(scenario: Scenario, spec: RotatingLidar) -> ForeignLight:
    """Return the foreign light that a LiDAR of a scenario gets."""
    sensors = (sensor for vehicle in scenario.vehicles for sensor in vehicle.sensors)
    lidars = sum(isinstance(sensor, RotatingLidar) for sensor in sensors)
    return ForeignLight(spec, scenario.world.sun, lidars - 1)


def threshold(spec: RotatingLidar, false_share: float) -> float:
    """Return the threshold, in units of the noise, that noise passes in a share of shots."""
    gate_s = 2 * (spec.max_range_m - spec.min_range_m) / LIGHT_MPS
    chances = gate_s / (2 * math.sqrt(3) * spec.pulse_length_ns * 1e-9)
    return math.sqrt(2 * math.log(max(chances / -math.log1p(-false_share), math.e**0.5)))
