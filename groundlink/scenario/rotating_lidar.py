# SPDX-License-Identifier: Apache-2.0
"""Scenario fields of all LiDARs with a turning head; the defaults describe an ideal device.

Consistency between fields is checked here, so that the loader reports a mistake with file and line
before any process starts.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from groundlink.core.clock import exact
from groundlink.core.fields import Fraction01, NonNegative, Positive, Spec
from groundlink.messages.reading_schedule import Blocks, ReadingSchedule

from .every_sensor import Rate, SensorSpec
from .faults import Quantity


class EchoBands(Spec, frozen=True, kw_only=True):
    """Noise and dropout by intensity and range.

    Between the knots values are linear in both; beyond the ends they are those of the ends.
    """

    intensity: tuple[NonNegative, ...]
    """Intensities of the rows, ascending, as the device reports them."""

    range_m: tuple[NonNegative, ...]
    """Ranges of the columns, ascending."""

    stddev_m: tuple[tuple[NonNegative, ...], ...] = ()
    """White noise of a range measurement, 1 sigma, by intensity, then by range; empty: none. It is
    independent of the other noise sources."""

    dropout: tuple[tuple[Fraction01, ...], ...] = ()
    """Share of returns that are dropped at random, by intensity, then by range; empty: none. The
    field `dropout` beside this table acts on what is left."""

    def __post_init__(self) -> None:
        for name in ("intensity", "range_m"):
            knots = getattr(self, name)
            if not knots or any(a >= b for a, b in pairwise(knots)):
                raise ValueError(f"`{name}` is {list(knots)}; expected ascending numbers")
        for name in ("stddev_m", "dropout"):
            table = getattr(self, name)
            shape = [len(self.range_m)] * len(self.intensity)
            if table and [len(row) for row in table] != shape:
                raise ValueError(
                    f"`{name}` has rows of {[len(row) for row in table]} values; expected a row "
                    f"for each of {len(shape)} intensities, each with {len(self.range_m)} ranges"
                )


class Blooming(Spec, frozen=True, kw_only=True):
    """Stray light of retroreflectors in beams that pass them."""

    share: Fraction01
    """Share of a retroreflector's light that a beam gets at the edge of its footprint."""

    width_mrad: Positive
    """Angle beyond the footprint over which this share falls by a factor of e."""


class Sunlight(Spec, frozen=True, kw_only=True):
    """Effect of sunlight on a receiver."""

    reach_share: Annotated[float, Meta(gt=0, lt=1)]
    """Largest range on surfaces of `full_range_reflectivity` in full sunlight, as a share of that
    in the dark."""

    false_share: Annotated[float, Meta(gt=0, lt=1)]
    """Share of shots in which noise of the receiver alone gives a return, at any range."""

    glare_deg: NonNegative = 0.0
    """Angle from the sun at which scattered light in the optics is as bright as a white surface in
    full sunlight. It falls with the square of the angle. 0: none."""


class TurningMirror(Spec, frozen=True):
    """A fast turning mirror whose tilt changes slowly: it scans without repeating itself."""

    turns_per_s: Positive
    """Turns per second."""

    tilt_period_s: Positive
    """Time in which the tilt goes from the highest elevation to the lowest and back."""

    elevations_deg: tuple[float, float]
    """Highest and lowest elevation of the middle of the fan of beams."""


class TurningPrisms(Spec, frozen=True):
    """Two turning wedges of glass, a Risley pair: they scan a disc ahead without repeating it."""

    turns_per_s: tuple[float, float]
    """Turns per second of the first wedge and of the second, by the right hand about x."""

    wedge_deg: Annotated[float, Meta(gt=0, lt=45)]
    """Angle between the faces of a wedge."""

    refractive_index: Annotated[float, Meta(gt=1, le=4)]
    """Refractive index of the glass."""


class RotatingLidar(SensorSpec, frozen=True, kw_only=True):
    """Base of all LiDARs with a turning head, which fires all its lasers once per azimuth step."""

    quantities: ClassVar = {"range": Quantity("m")}
    rate_field: ClassVar[str] = "rotation_rate_hz"

    rotation_rate_hz: Rate = 10.0
    """Revolutions per second of sim time."""

    firings_per_revolution: Annotated[int, Meta(ge=16, le=36000)] = 3600
    """Azimuth steps per revolution. 3600 steps at 10 Hz give a step of 0.1 degrees."""

    azimuth_resolution_deg: NonNegative = 0.0
    """Resolution of the head's encoder: at each encoder reading the head's azimuth is a multiple of
    this value. 0: any azimuth."""

    firings_per_azimuth: Annotated[int, Meta(ge=1, le=360)] = 1
    """Firings per encoder reading. Between two readings the head turns at a constant rate."""

    start_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    """Azimuth of the first firing of a revolution: 0 ahead, 90 to the left (REP 103)."""

    rotation: Literal["clockwise", "counterclockwise"] = "clockwise"
    """Direction of rotation, seen from above."""

    field_of_view_deg: Annotated[float, Meta(gt=0, le=360)] = 360.0
    """Azimuth from the first firing to the last, both included. No laser fires outside it."""

    block_deg: NonNegative = 0.0
    """Azimuth range of one message. 0 for whole revolutions; otherwise it divides the field of view
    evenly."""

    elevations_deg: tuple[float, ...] = (0.0,)
    """Elevation of each laser, from the lowest (ring 0) to the highest."""

    azimuth_offsets_deg: tuple[float, ...] = ()
    """Azimuth of each laser relative to the head, positive in the direction of rotation; empty:
    zero."""

    vertical_offsets_m: tuple[float, ...] = ()
    """Height of each laser's origin above the sensor's origin; empty: zero."""

    laser_times_us: tuple[float, ...] = ()
    """Time of each laser after the start of its firing; empty: all lasers fire at once."""

    divergence_mrad: tuple[NonNegative, NonNegative] = (0.0, 0.0)
    """Width and height of a beam, as full angles."""

    rays_per_beam: Annotated[int, Meta(ge=1, le=64)] = 1
    """Number of rays that sample a beam evenly, a square number. 1: only the axis of the beam."""

    returns: Literal["strongest", "last", "dual"] = "strongest"
    """Returns that are reported if a beam hits several surfaces. `dual`: the last return and the
    strongest, or the second strongest if the last is the strongest."""

    pulse_length_ns: Positive = 6.0
    """Pulse length. Surfaces closer to each other than half the length of the pulse give one
    return: 0.9 m for 6 ns."""

    min_range_m: NonNegative = 0.0
    """Smallest range; nearer surfaces give no return."""

    max_range_m: Positive = 100.0
    """Largest range; farther surfaces give no return."""

    full_range_reflectivity: Fraction01 = 0.0
    """Smallest reflectivity that is detected at the largest range, at normal incidence in clear
    air. The received light is proportional to reflectivity over distance squared. 0: everything
    up to the largest range is detected, whatever its reflectivity and the weather."""

    intensity: Literal["calibrated", "received"] = "calibrated"
    """`calibrated`: reflectivity independent of distance, 100 for white, 101 to 255 for
    retroreflectors. `received`: received light, 100 for white at 10 m."""

    range_stddev_m: NonNegative = 0.0
    """White noise of a range measurement, 1 sigma."""

    range_stddev_share: NonNegative = 0.0
    """White noise proportional to the range, 1 sigma, as a share of the range."""

    laser_stddevs_m: tuple[NonNegative, ...] = ()
    """Additional white noise of each laser, 1 sigma; empty: none. All noise sources are
    independent."""

    laser_bias_m: NonNegative = 0.0
    """Half width of the uniform distribution from which each laser's constant bias is drawn."""

    azimuth_stddev_deg: NonNegative = 0.0
    """Error of a beam's true azimuth against the reported one, 1 sigma."""

    elevation_stddev_deg: NonNegative = 0.0
    """Error of a beam's true elevation against the reported one, 1 sigma."""

    range_resolution_m: NonNegative = 0.0
    """Quantization step of ranges; 0 for none."""

    dropout: Fraction01 = 0.0
    """Share of returns that are dropped at random."""

    echo_bands: EchoBands | None = None
    """Noise and dropout by intensity and range, in addition to the constant ones."""

    mixed_pixels: bool = False
    """Whether beams at the edge of a surface get light of the surface behind it, too: points
    between the two, and weaker ones before the sky. Needs the width in `divergence_mrad`;
    `rays_per_beam` above 1 does the same with rays."""

    blooming: Blooming | None = None
    """Stray light of retroreflectors in beams that pass them. Default: none."""

    sun: Sunlight | None = None
    """Sunlight, which acts in worlds that the sun lights: a higher threshold, noisier ranges and
    false returns. Needs `full_range_reflectivity`. Default: none."""

    crosstalk_share: Fraction01 = 0.0
    """Share of shots into which a pulse of another LiDAR falls, for each other LiDAR of the
    scenario. It gives a return at any range."""

    def __post_init__(self) -> None:
        for problem in self._problems():
            raise ValueError(problem)

    def _problems(self) -> Iterator[str]:
        """Yield the inconsistencies between fields."""
        lasers = len(self.elevations_deg)
        if not lasers:
            yield "`elevations_deg` is empty; expected an angle for each laser"
        for field in _PER_LASER:
            values = getattr(self, field)
            if values and len(values) != lasers:
                yield (
                    f"`{field}` has {len(values)} values, but `elevations_deg` has {lasers}; give "
                    "one for each laser, or none at all"
                )
        if self.min_range_m >= self.max_range_m:
            yield (
                f"`min_range_m` is {self.min_range_m:g}; expected less than `max_range_m`, "
                f"{self.max_range_m:g}"
            )
        if math.isqrt(self.rays_per_beam) ** 2 != self.rays_per_beam:
            yield f"`rays_per_beam` is {self.rays_per_beam}; expected a square: 1, 4, 9, 16 .. 64"
        if self.rays_per_beam > 1 and not any(self.divergence_mrad):
            yield (
                f"`rays_per_beam` is {self.rays_per_beam}, but `divergence_mrad` is zero; give the "
                "beam a width, or leave it at 1 ray"
            )
        if self.mixed_pixels and not (self.divergence_mrad[0] and self.rays_per_beam == 1):
            yield (
                "`mixed_pixels` needs a width in `divergence_mrad` and `rays_per_beam: 1`; got "
                f"{self.divergence_mrad[0]:g} and {self.rays_per_beam}"
            )
        if self.blooming and self.rays_per_beam > 1:
            yield f"`blooming` needs `rays_per_beam: 1`; got {self.rays_per_beam}"
        if self.sun and not self.full_range_reflectivity:
            yield "`sun` needs a threshold of detection; expected `full_range_reflectivity` above 0"
        if self.firings_per_revolution % self.firings_per_azimuth:
            yield (
                f"`firings_per_revolution` is {self.firings_per_revolution}; expected a multiple "
                f"of `firings_per_azimuth`, {self.firings_per_azimuth}"
            )
        if self.block_deg:
            blocks = exact(self.field_of_view_deg) / exact(self.block_deg)
            if blocks.denominator != 1 or not 1 <= blocks <= self.firings_in_view:
                yield (
                    f"`block_deg` is {self.block_deg:g}; expected 0 or {self.field_of_view_deg:g} "
                    f"divided by a whole number up to the {self.firings_in_view} firings of a "
                    "revolution"
                )

    @property
    def message_rate_hz(self) -> float:
        """Messages per second of sim time: one for each block of a revolution."""
        return self.rotation_rate_hz * self.blocks_per_revolution

    @property
    def measuring_s(self) -> float:
        """Duration of a block, in seconds."""
        return 1 / self.message_rate_hz

    def schedule(self) -> ReadingSchedule:
        """Return the schedule of the blocks."""
        return Blocks(self)

    @property
    def largest_block_firings(self) -> int:
        """Firings of the largest block. If they do not divide evenly, some blocks have one more."""
        return -(-self.firings_in_view // self.blocks_per_revolution)

    @property
    def firings_in_view(self) -> int:
        """Firings of a revolution within the field of view."""
        if self.field_of_view_deg == 360:
            return self.firings_per_revolution
        return int(exact(self.field_of_view_deg) * self.firings_per_revolution / 360) + 1

    @property
    def blocks_per_revolution(self) -> int:
        """Messages per revolution."""
        return int(exact(self.field_of_view_deg) / exact(self.block_deg)) if self.block_deg else 1

    @property
    def cell_m(self) -> float:
        """Range resolution: half the length of a pulse, in meters."""
        return LIGHT_MPS * self.pulse_length_ns * 1e-9 / 2

    @property
    def least_power(self) -> float:
        """Smallest detected power, in percent of a white surface's light over m^2."""
        return 100 * self.full_range_reflectivity / self.max_range_m**2

    @property
    def returns_per_ray(self) -> int:
        """Largest number of reported returns of a laser's shot."""
        return 2 if self.returns == "dual" else 1


LIGHT_MPS = 299_792_458.0

_PER_LASER = ("azimuth_offsets_deg", "laser_stddevs_m", "laser_times_us", "vertical_offsets_m")
"""Fields with one value for each laser, or empty."""
