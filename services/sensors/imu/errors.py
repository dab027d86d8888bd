# SPDX-License-Identifier: Apache-2.0
"""What is wrong with an IMU's readings: white noise, the bias of this run, a tilted orientation.

Rule: an error depends on the scenario's seed, the sensor's name and the number of the sample, never
on the samples before it, so that a restart goes on as if nothing had happened. Drift that walks is
not modelled.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from groundlink.clock import Schedule
from groundlink.scenario.sensors import Imu, InertialNoise
from services.sensors.noise import PolarNormal
from services.sensors.streams import RandomStreams

BLOCK_SAMPLES = 128
"""Samples whose errors are drawn together, from one stream: spreads the cost of its set-up."""


def white_stddev(noise: InertialNoise, rate_hz: float) -> float:
    """Return sigma of one sample: density times sqrt(rate), in the quantity's unit.

    The discrete form of continuous white noise, as the IMU noise model of Kalibr has it.
    """
    return noise.noise_density * math.sqrt(rate_hz)


class ImuErrors:
    """The errors of one IMU, as rows of nine numbers a sample.

    A row is what to add to the specific force (m/s^2) and to the angular rate (rad/s), and by which
    rotation vector (rad) the orientation is off, all along the sensor's axes x, y, z.
    """

    def __init__(self, spec: Imu, streams: RandomStreams) -> None:
        self._streams = streams
        self._schedule = Schedule.at(spec.rate_hz)
        self._stddevs = np.repeat(
            [
                white_stddev(spec.accelerometer, spec.rate_hz),
                white_stddev(spec.gyroscope, spec.rate_hz),
                math.radians(spec.orientation_stddev_deg),
            ],
            3,
        )
        bias_stddevs = [spec.accelerometer.turn_on_bias, spec.gyroscope.turn_on_bias, 0.0]
        turn_on = PolarNormal(streams.at("turn_on_bias", 0)).draw(9)
        self._biases: NDArray[np.float64] = np.repeat(bias_stddevs, 3) * turn_on
        self._block = -1
        self._rows: list[list[float]] = []

    def of_sample(self, index: int) -> list[float]:
        """Return the errors of sample `index`, nine floats."""
        block, row = divmod(index, BLOCK_SAMPLES)
        if block != self._block:
            # Samples are at least a tick apart, so no two blocks begin at the same tick.
            generator = self._streams.at("white", self._schedule.tick(block * BLOCK_SAMPLES))
            normal = PolarNormal(generator).draw(BLOCK_SAMPLES * 9).reshape(-1, 9)
            self._rows = (normal * self._stddevs + self._biases).tolist()
            self._block = block
        return self._rows[row]
