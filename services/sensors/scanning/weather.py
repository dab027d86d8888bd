# SPDX-License-Identifier: Apache-2.0
"""Fog, dust and rain: how they attenuate a beam and scatter it back.

On the way to a range R and back, exp(-2 a R) of the light remains. Fog and dust scatter light back
from where a pulse enters them, as soft targets; raindrops do individually. These returns compete
with that of the surface behind: the receiver detects them above its threshold, and reports one that
is the strongest, or one of two.

Fog and dust: a = ln 20 / visibility (Koschmieder, 5 %), and backscatter 0.046 / visibility per
meter and steradian, with no echo from nearer than 1 m, where the fields of the laser and of the
receiver hardly overlap: Hahner et al. (2021), "Fog simulation on real LiDAR point clouds for 3D
object detection in adverse weather", after Rasshofer et al. (2011). Only the first half of a
pulse's length counts, and the echo lies anywhere in it.

Rain: a = 0.01 r^0.6 per meter at r mm/h (Goodin et al. 2019, "Predicting the influence of rain on
LIDAR in ADAS"). Of drops there are 8000 exp(-4.1 r^-0.21 D) per m^3 and mm of diameter D (Marshall
and Palmer 1948). A drop is detected if its share of the beam scatters enough light back; of those
before the nearest surface the first counts. The reflectance of a drop and the beam's initial width
are our own estimates.
"""

import ctypes
import math
from ctypes import c_float, c_size_t, c_void_p

import numpy as np

from groundlink.core.frames import Floats
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.world.weather import Weather
from services.sensors.rays.scene import Reals

NEAREST_M = 1.0
DROP_REFLECTANCE = 0.005
"""A sphere of water scatters 2 % (Fresnel) of the light on its front evenly around, a fourth of
what a white disc sends back."""

BEAM_AT_START_M = 0.01
STEPS = 256


class _Weather(ctypes.Structure):
    """The structure `weather` of `returns.c`."""

    _fields_ = (
        *((name, c_float) for name in ("extinction", "haze", "near", "drops_per_mm")),
        *((name, c_size_t) for name in ("steps", "clouds")),
        *((name, c_void_p) for name in ("ranges", "drops", "least_mm", "dust")),
    )


class Atmosphere:
    """The air in front of one device.

    Attributes
    ----------
    extinction_per_m : float
        Of fog and rain together.
    drop_ranges_m, drops, least_drops_mm : float32 arrays, shape (steps,)
        By range: mean number of detectable drops in a beam up to there, and the smallest diameter
        that is detectable at this range. Empty without rain.
    structure : ctypes.Structure
        Input of the compiled pass.

    Parameters
    ----------
    spec : RotatingLidar
        Gives the power that is needed for a detection.
    weather : Weather
    """

    def __init__(self, spec: RotatingLidar, weather: Weather) -> None:
        rate = weather.rain_mm_per_h
        fog, haze = _hazy(weather.fog_visibility_m or math.inf, spec.cell_m)
        self.extinction_per_m = fog + 0.01 * rate**0.6
        nearest = max(NEAREST_M, spec.min_range_m)
        drops_per_mm = 4.1 * rate**-0.21 if rate else 0.0
        none: Reals = np.empty(0, np.float32)
        self.drop_ranges_m, self.drops, self.least_drops_mm = none, none, none
        if rate and nearest < spec.max_range_m:
            ranges: Floats = np.geomspace(nearest, spec.max_range_m, STEPS)
            across, upward = (BEAM_AT_START_M + 1e-3 * d * ranges for d in spec.divergence_mrad)
            area = across * upward
            # A drop of this diameter is just bright enough.
            depth = np.minimum(2 * self.extinction_per_m * ranges, 80)  # no drop is so bright
            light = spec.least_power * ranges**2 * np.exp(depth)
            least_mm = 1e3 * np.sqrt(4 / math.pi * area * light / (100 * DROP_REFLECTANCE))
            per_m = area * 8000 / drops_per_mm * np.exp(-drops_per_mm * least_mm)
            steps = np.diff(ranges) * (per_m[1:] + per_m[:-1]) / 2
            self.drop_ranges_m = ranges.astype(np.float32)
            self.drops = np.concatenate([[0.0], np.cumsum(steps)]).astype(np.float32)
            self.least_drops_mm = least_mm.astype(np.float32)
        boxes = []
        for dust in weather.dust:
            center, half = np.array(dust.center_m), np.array(dust.size_m) / 2
            boxes.append(
                [*(center - half), *(center + half), *_hazy(dust.visibility_m, spec.cell_m)]
            )
        self._dust = np.array(boxes, np.float32)
        self.structure = _Weather(
            *(self.extinction_per_m, haze, nearest, drops_per_mm),
            *(len(self.drops), len(boxes)),
            *(self.drop_ranges_m.ctypes.data, self.drops.ctypes.data),
            *(self.least_drops_mm.ctypes.data, self._dust.ctypes.data),
        )


def atmosphere_of(spec: RotatingLidar, weather: Weather) -> Atmosphere | None:
    """Return the air around a device; None if it is clear, or the device has no threshold."""
    return Atmosphere(spec, weather) if not weather.is_clear and spec.least_power else None


def _hazy(visibility_m: float, cell_m: float) -> tuple[float, float]:
    """Return extinction per meter, and the percentage of light that half a pulse scatters back.

    A diffuse surface sends back rho / pi per steradian.
    """
    return math.log(20) / visibility_m, 100 * math.pi * 0.046 / visibility_m * cell_m
