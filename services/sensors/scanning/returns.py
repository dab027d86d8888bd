# SPDX-License-Identifier: Apache-2.0
"""LiDAR receiver: turns hits of rays into returns.

A surface returns rho cos(incidence) / R^2 of the light, less what the air absorbs, and is detected
above a threshold. Rays of a beam that end within half a pulse's length of the next one form one
return, at the mean of their ranges weighted by power. Errors act on detections in this order: white
noise, the laser's bias, rounding, limits, dropout. Surfaces are hit from either side. Noise and
dropout may depend on intensity and range (`echo_bands.py`), and a beam may get light of surfaces
beside its axis (`stray_light.py`), of the sun and of other LiDARs (`foreign_light.py`).

Not modeled: the pulse's shape, mirrors, glass.
"""

import ctypes
from ctypes import c_float, c_int32, c_size_t, c_void_p
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.world.solids import RETROREFLECTION
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rays.kernels import kernels
from services.sensors.rays.scene import Hits, Numbers, Reals

from .beams import Rays
from .draws import RevolutionDraws
from .echo_bands import BandTable
from .foreign_light import END, FalseReturns, ForeignLight
from .stray_light import ECHO_BYTES, StrayLight
from .sweep import Sweep
from .weather import Atmosphere


class Returns(NamedTuple):
    """Returns of some firings of a revolution.

    All arrays have the shape (returns, lasers, firings), lasers in the order in which they fire. Of
    the first axis 0 is the return that the device reports first; with `returns: dual` 0 is the last
    and 1 is the strongest, or the second strongest where the last is the strongest, and a beam with
    one return has `returned` in 0 alone.
    """

    range_m: Reals
    """As measured: with noise, bias and rounding. Without a return it says one thing only: it is
    below the minimum range if something was too near."""

    returned: NDArray[np.bool_]
    intensity: Reals
    """As the device reports it. `calibrated`: 100 rho cos(incidence), a whole number; 101..255 is
    for retroreflectors (VLP-16 User Manual 63-9243, calibrated reflectivities)."""

    true_range_m: Reals
    """Without error, along the true ray; infinite without a detection."""

    label: Numbers
    """Label of the solid that was hit; -1 for fog, dust, rain, or no detection."""

    body: Numbers
    """Number of the moving body that was hit; -1 for a static one, or none."""

    ray: Numbers
    """Number within its beam of the ray that returned most of the light; 0 for none. For stray
    light, the distance to that ray in the array of all rays."""

    def of(self, firings: slice) -> "Returns":
        """Return views of some of these firings."""
        return Returns._make(array[..., firings] for array in self)


class _Receiver(ctypes.Structure):
    """The structure `receiver` of `returns.c`."""

    _fields_ = (
        *((name, c_size_t) for name in ("lasers", "firings", "rays")),
        *((name, c_int32) for name in ("mode", "received")),
        *((name, c_float) for name in ("range_share", "range_resolution")),
        *((name, c_float) for name in ("min_range", "max_range", "dropout", "cell", "least_power")),
        *((name, c_void_p) for name in ("stddev", "bias", "reflectance")),
        *(("retroreflection", c_float), ("weather", c_void_p)),
        *(("bands", c_void_p), ("reach", c_float), ("blooming", c_void_p), ("sun", c_void_p)),
    )


class _Hits(ctypes.Structure):
    """The structure `hits` of `returns.c`."""

    _fields_ = (
        ("rays", c_size_t),
        *((name, c_void_p) for name in ("origins", "directions", "range", "normals")),
        *((name, c_void_p) for name in ("labels", "bodies")),
    )


class _Returns(ctypes.Structure):
    """The structure `returns` of `returns.c`."""

    _fields_ = tuple((name, c_void_p) for name in Returns._fields)


MODES = ("strongest", "last", "dual")
"""The enumeration of `returns.c`."""


class LidarReceiver:
    """The receiver of a data sheet.

    Parameters
    ----------
    spec : RotatingLidar
    sweep : Sweep
    reflectance : float32 array
        `Material.reflectance` by label.
    air : Air or None
        None for clear air.
    stray : StrayLight
    foreign : ForeignLight
    streams : RandomStreams
    draws : Draws

    Attributes
    ----------
    bias_m : float32 array, shape (lasers,)
        Constant error of each laser, in the order of firing.
    """

    def __init__(
        self,
        spec: RotatingLidar,
        sweep: Sweep,
        reflectance: Reals,
        air: Atmosphere | None,
        stray: StrayLight,
        foreign: ForeignLight,
        streams: RandomStreams,
        draws: RevolutionDraws,
    ) -> None:
        self._spec, self._draws, self._air, self._stray = spec, draws, air, stray
        self._foreign, sunlight = foreign, foreign.sunlight
        bands = spec.echo_bands
        self._bands = None if bands is None else BandTable(bands)
        lasers, firings = len(sweep.rings), sweep.seconds.shape[1]
        bias = streams.at("bias", 0).uniform(-spec.laser_bias_m, spec.laser_bias_m, lasers)
        self.bias_m: Reals = bias[sweep.rings].astype(np.float32)
        of_laser = np.array(spec.laser_stddevs_m or [0.0] * lasers)[sweep.rings]
        self._stddevs: Reals = np.hypot(spec.range_stddev_m, of_laser).astype(np.float32)
        banded = bands is not None and bool(bands.stddev_m)
        self._noisy = bool(self._stddevs.any()) or spec.range_stddev_share > 0 or banded
        self._noisy = self._noisy or sunlight is not None
        self._loses = spec.dropout > 0 or (bands is not None and bool(bands.dropout))
        self._shape = spec.returns_per_ray, lasers, firings
        self._reflectance = np.append(reflectance, np.float32(0))  # of hits on nothing
        blooming = stray.blooming if reflectance.max(initial=0) > 1 else None
        # Allocated once: pages of new memory cost more than the computation.
        self._echoes = np.empty(0 if blooming is None else lasers * firings * ECHO_BYTES, np.uint8)
        self._structure = _Receiver(
            *(lasers, firings, spec.rays_per_beam),
            *(MODES.index(spec.returns), spec.intensity == "received"),
            *(spec.range_stddev_share, spec.range_resolution_m),
            *(spec.min_range_m, spec.max_range_m, spec.dropout),
            *(spec.cell_m, spec.least_power),
            *(array.ctypes.data for array in (self._stddevs, self.bias_m, self._reflectance)),
            *(RETROREFLECTION, None if air is None else ctypes.addressof(air.structure)),
            None if self._bands is None else ctypes.addressof(self._bands.structure),
            stray.reach,
            None if blooming is None else ctypes.addressof(blooming),
            None if sunlight is None else ctypes.addressof(sunlight),
        )

    def measure(self, hits: Hits, rays: Rays, firings: range, tick: int) -> Returns:
        """Return the device's measurements of hits.

        Parameters
        ----------
        hits : Hits
            Of `rays`.
        rays : Rays
            Of all lasers at these firings.
        firings : range
        tick : int
            Keys the random numbers of the revolution.
        """
        returns, lasers, _ = self._shape
        shape = returns, lasers, len(firings)
        dtypes = np.float32, np.bool_, np.float32, np.float32, *[np.int32] * 3
        made = Returns._make(np.empty(shape, dtype) for dtype in dtypes)
        met = rays.origins_in_world, rays.directions_in_world, hits.range_m, hits.normal_in_world
        drawn = self._drawn(tick)
        kernels().groundlink_returns(
            ctypes.byref(self._structure),
            ctypes.byref(
                _Hits(rays.times.size, *(a.ctypes.data for a in (*met, hits.label, hits.body)))
            ),
            ctypes.byref(_Returns(*(array.ctypes.data for array in made))),
            *(firings.start, firings.stop),
            *(None if numbers is None else numbers.ctypes.data for numbers in drawn),
            self._echoes.ctypes.data,
        )
        return made

    def _drawn(self, tick: int) -> tuple[Reals | FalseReturns | None, ...]:
        """Return a revolution's random numbers, where needed.

        These are of noise, dropout, air, edges and foreign light.
        """
        white = lost = air = gaps = None
        foreign: FalseReturns = END
        if self._noisy:
            white = self._draws.normals("range", tick, self._shape)
        if self._loses:
            lost = self._draws.of(
                "dropout", tick, lambda source: source.random(self._shape, np.float32)
            )
        if self._air is not None:
            air = self._draws.of(
                "air", tick, lambda source: source.random((3, *self._shape[1:]), np.float32)
            )
        if self._stray.reach:
            gaps = self._draws.of(
                "edges", tick, lambda source: source.random(self._shape[1:], np.float32)
            )
        if self._foreign.share:
            foreign = self._draws.of("foreign light", tick, self._foreign.false_returns)
        return white, lost, air, gaps, foreign
