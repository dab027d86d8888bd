# SPDX-License-Identifier: Apache-2.0
"""What is wrong with the axes of an accelerometer or a gyroscope, as data sheets say it.

Rule: every field at its default of zero is no error; quantities are in the unit of what is measured
(m/s^2, rad/s). What they mean in numbers is in `services.sensors.imu.errors`.
"""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import NonNegative, Spec

LOW_PASS_TAIL = 1e-9
"""Share of a step that a low pass leaves out, so that it is full after a finite time."""

Bandwidth = Annotated[float, Meta(ge=0, le=200)]


def low_pass_ticks(bandwidth_hz: float) -> int:
    """Return what a Butterworth low pass of second order takes to fill; 1 where there is none.

    Its step response is within sqrt(2) exp(-at) of 1, with a = 2 pi f / sqrt(2).
    """
    if not bandwidth_hz:
        return 1
    a = math.sqrt(2) * math.pi * bandwidth_hz
    return math.ceil(math.log(math.sqrt(2) / LOW_PASS_TAIL) / (a * TICK_SECONDS))


class InertialNoise(Spec, frozen=True):
    """Errors of a triad of axes."""

    noise_density: NonNegative = 0.0
    """Per root hertz, of a unit of the quantity; white sigma is this times sqrt(rate), the Allan
    deviation at 1 s is this (a two-sided spectrum; a one-sided one says sqrt(2) times as much)."""

    bias_instability: NonNegative = 0.0
    """In-run bias stability: the highest Allan deviation of the bias that wanders and comes back (a
    Gauss-Markov process), in the quantity's unit."""

    bias_time_constant_s: Annotated[float, Meta(ge=1)] = 100.0
    """After which the wandering bias has forgotten all but 1/e of itself."""

    random_walk: NonNegative = 0.0
    """Density of the bias that walks away, in the quantity's unit per second per root hertz."""

    turn_on_bias: NonNegative = 0.0
    """1 sigma of the constant offset drawn for a run, in the quantity's unit."""

    scale_factor: NonNegative = 0.0
    """1 sigma of each axis's relative error of scale, drawn for a run."""

    misalignment_deg: NonNegative = 0.0
    """1 sigma of the angles by which each axis leans towards the two others, drawn for a run."""

    bandwidth_hz: Bandwidth = 0.0
    """Where the low pass of second order (Butterworth), which all but the orientation goes through,
    has -3 dB; 0 for none."""

    saturation: NonNegative = 0.0
    """Largest magnitude that an axis measures, in the quantity's unit; 0 for no limit."""

    resolution: NonNegative = 0.0
    """Readings are rounded to multiples of it; 0 for none."""

    def __post_init__(self) -> None:
        if 0 < self.bandwidth_hz < 5:
            raise ValueError("`bandwidth_hz` is below 5; expected 0 for none, or 5 to 200")

    @property
    def low_pass_ticks(self) -> int:
        """After how many ticks something comes out of the low pass."""
        return low_pass_ticks(self.bandwidth_hz)


class GyroscopeNoise(InertialNoise, frozen=True):
    """Errors of the gyroscope's axes."""

    g_sensitivity: NonNegative = 0.0
    """1 sigma of the rate that an axis reads for each m/s^2 along x, y and z, in rad/s per m/s^2,
    drawn for a run."""
