# SPDX-License-Identifier: Apache-2.0
"""Specification of an inertial measurement unit in a scenario.

The errors are in the quantities of data sheets, in the unit of the measured quantity (m/s^2,
rad/s); `errors` computes them. A field at its default of zero means no error.
"""

import math
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from groundlink.core.clock import TICK_NANOS, TICK_SECONDS
from groundlink.core.fields import NonNegative, Positive, Spec
from groundlink.messages.base import Imu
from groundlink.messages.reading_schedule import Events, ReadingSchedule
from groundlink.scenario.every_sensor import Carrier, Rate, SensorSpec
from groundlink.scenario.faults import Quantity

LOW_PASS_TAIL = 1e-9
"""Remaining share of a step response below which a low pass counts as settled."""

Bandwidth = Annotated[float, Meta(ge=0, le=200)]


def low_pass_ticks(bandwidth_hz: float) -> int:
    """Return the settling time of a second-order Butterworth low pass in ticks; 1 without one.

    Its step response is within sqrt(2) exp(-at) of 1, with a = 2 pi f / sqrt(2).
    """
    if not bandwidth_hz:
        return 1
    a = math.sqrt(2) * math.pi * bandwidth_hz
    return math.ceil(math.log(math.sqrt(2) / LOW_PASS_TAIL) / (a * TICK_SECONDS))


class InertialNoise(Spec, frozen=True):
    """Errors of a triad of axes."""

    noise_density: NonNegative = 0.0
    """Noise density in units of the quantity per root hertz. The sigma of the white noise is this
    value times sqrt(rate); the Allan deviation at 1 s is this value. It is the root of a
    two-sided spectrum; a one-sided spectrum gives sqrt(2) times as much."""

    bias_instability: NonNegative = 0.0
    """In-run bias stability, in the quantity's unit: the highest Allan deviation of the
    time-correlated bias (a Gauss-Markov process)."""

    bias_time_constant_s: Annotated[float, Meta(ge=1)] = 100.0
    """Correlation time of that bias: its autocorrelation falls to 1/e."""

    random_walk: NonNegative = 0.0
    """Density of the random walk of the bias, in the quantity's unit per second per root hertz."""

    turn_on_bias: NonNegative = 0.0
    """1 sigma of the constant bias, drawn once per run, in the quantity's unit."""

    scale_factor: NonNegative = 0.0
    """1 sigma of the relative scale error of each axis, drawn once per run."""

    misalignment_deg: NonNegative = 0.0
    """1 sigma of the angles between each axis and its nominal direction, towards each of the other
    two axes, drawn once per run."""

    bias_per_k: NonNegative = 0.0
    """1 sigma of the bias for each kelvin from 25 degrees Celsius, drawn once per run for each
    axis, in the quantity's unit. Acts where the world's weather has a temperature."""

    scale_per_k: NonNegative = 0.0
    """1 sigma of the relative scale error for each kelvin from 25 degrees Celsius, likewise."""

    bandwidth_hz: Bandwidth = 0.0
    """-3 dB frequency of the second-order Butterworth low pass; 0 for no low pass. The orientation
    is not filtered."""

    saturation: NonNegative = 0.0
    """Largest magnitude of a measurement on an axis, in the quantity's unit; 0 for no limit."""

    resolution: NonNegative = 0.0
    """Quantization step of the readings, in the quantity's unit; 0 for none."""

    def __post_init__(self) -> None:
        if 0 < self.bandwidth_hz < 5:
            raise ValueError("`bandwidth_hz` is below 5; expected 0 for none, or 5 to 200")

    @property
    def low_pass_ticks(self) -> int:
        """Settling time of the low pass in ticks."""
        return low_pass_ticks(self.bandwidth_hz)


class GyroscopeNoise(InertialNoise, frozen=True):
    """Errors of the axes of the gyroscope."""

    g_sensitivity: NonNegative = 0.0
    """1 sigma of the rate error of an axis for each m/s^2 along x, y and z, in rad/s per m/s^2,
    drawn once per run."""


class InertialUnit(SensorSpec, frozen=True, tag="imu"):
    """Accelerometer, gyroscope and orientation filter in one housing."""

    quantities: ClassVar = {
        "acceleration": Quantity("m/s^2", ("x", "y", "z"), "linear_acceleration_mps2"),
        "angular_velocity": Quantity("rad/s", ("x", "y", "z"), "angular_velocity_radps"),
    }
    rate_hz: Rate = 400.0
    """Samples per second of sim time."""

    accelerometer: InertialNoise = InertialNoise()
    """Errors of the accelerometer, in m/s^2."""

    gyroscope: GyroscopeNoise = GyroscopeNoise()
    """Errors of the gyroscope, in rad/s."""

    orientation_stddev_deg: NonNegative = 0.0
    """White noise of the orientation about each axis, 1 sigma."""

    self_heating_k: NonNegative = 0.0
    """How much warmer than the air the sensor becomes. It starts as warm as the air, where the
    world's weather has a temperature."""

    warm_up_s: Positive = 300.0
    """Time constant of the self-heating: time to 63 % of it."""

    noise_source: Literal["marsaglia", "numpy"] = "marsaglia"
    """Generator of normally distributed numbers: Marsaglia's polar method as in the paper, or
    numpy's ziggurat."""

    def schedule(self) -> ReadingSchedule:
        """Return the schedule of samples; it begins after the low passes have settled."""
        ticks = max(triad.low_pass_ticks for triad in (self.accelerometer, self.gyroscope))
        filled = Events(self.rate_hz).at_or_after(TICK_NANOS * ticks)
        return Events(self.rate_hz, filled + 1)

    def largest_message(self, carrier: Carrier) -> Imu:
        """Return a sample; all have the same size."""
        frame, still = carrier.frame_prefix + self.frame, (0.0, 0.0, 0.0)
        return Imu(0, frame, (0.0, 0.0, 0.0, 1.0), still, still, 0.0, 0.0, 0.0)
