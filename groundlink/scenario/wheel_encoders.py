# SPDX-License-Identifier: Apache-2.0
"""Scenario fields of incremental encoders.

The kind `encoders` has these fields. The kinds and the base driver that turn its counts into angles
read them.
"""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Fraction01, NonNegative, Positive

from .every_sensor import Rate, SensorSpec


class IncrementalEncoders(SensorSpec, frozen=True):
    """Base of all kinds that count the turns of a vehicle's wheels."""

    rate_hz: Rate = 50.0
    """Messages per second of sim time."""

    ticks_per_revolution: Annotated[int, Meta(gt=0)] = 4096
    """Periods of the encoder per revolution of its own shaft; 6 for Hall sensors, per electrical
    revolution (one pole pair). If the next three fields are 1: counts per revolution of the
    wheel, with x4 decoding and gearing included."""

    quadrature: Literal[1, 2, 4] = 1
    """Edges that are counted per period."""

    pole_pairs: Annotated[int, Meta(gt=0)] = 1
    """Pole pairs of a motor whose Hall sensors are counted."""

    gear_ratio: Positive = 1.0
    """Revolutions of the encoder's shaft per revolution of the wheel."""

    reversed_wheels: tuple[str, ...] = ()
    """Wheels whose counters count down when they roll forward, such as motors mounted in mirror
    image."""

    start_ticks: Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)] = 0
    """Initial value of every counter. Counters wrap at 64 bits."""

    missed_ticks: Fraction01 = 0.0
    """Probability that an edge is not counted."""

    scale_stddev: NonNegative = 0.0
    """1 sigma of the relative scale error of each wheel, drawn once per run. It stands for a tire
    whose radius differs from the nominal one."""

    eccentricity_deg: NonNegative = 0.0
    """Amplitude of an error of the counted angle that repeats once per turn of the wheel, as of a
    disc that is mounted off its center. Its phase is drawn once per run for each wheel."""

    slip_stddev: NonNegative = 0.0
    """1 sigma, in radians after one radian, of the difference between a wheel's counted angle and
    the angle that it rolled on the ground. It grows with the square root of the angle."""

    resets_s: tuple[NonNegative, ...] = ()
    """Sim times, in order, at which the counters restart at zero."""

    def __post_init__(self) -> None:
        if list(self.resets_s) != sorted(self.resets_s):
            raise ValueError("`resets_s` is out of order; expected each time after the one before")

    @property
    def accumulates(self) -> bool:
        """Return whether readings depend on all states before: missed edges are drawn for each."""
        return self.missed_ticks > 0

    @property
    def ticks_per_wheel_revolution(self) -> float:
        """Counts per revolution of the wheel, without missed edges."""
        return self.ticks_per_revolution * self.quadrature * self.pole_pairs * self.gear_ratio
