# SPDX-License-Identifier: Apache-2.0
"""IMU errors: white noise, constant, wandering and thermal biases, and axis misalignment.

An error is a function of the scenario's seed, the sensor's name and the tick; it does not depend on
the start time of the process. A restarted process therefore continues with the same errors.
Vibration has no effect, and scale errors do not depend on the measured magnitude.
"""

import math

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS, Schedule
from groundlink.core.fields import Vector3
from services.sensors.noise.error_processes import BLOCK_TICKS, ErrorProcesses
from services.sensors.noise.normal import NORMALS
from services.sensors.noise.random_streams import RandomStreams

from .lowpass import Six
from .spec import InertialNoise, InertialUnit

BLOCK_SAMPLES = 128
"""Number of samples whose orientation errors are drawn together."""

PEAK_OF_GAUSS_MARKOV = 0.61736
"""Highest Allan deviation of a Gauss-Markov process of sigma 1, at 1.89 time constants (IEEE Std
952-1997, C.1.4, which gives the variance as 2 T/t (1 - T/(2t) (3 - 4 exp(-t/T) + exp(-2t/T))))."""


CALIBRATED_C = 25.0
"""Temperature at which there are no thermal errors."""


class ImuErrors:
    """Error model of an IMU: axis errors for each tick, orientation errors for each sample.

    Parameters
    ----------
    air_c
        temperature of the air; None: the sensor is at that of its calibration.
    """

    def __init__(
        self, spec: InertialUnit, streams: RandomStreams, air_c: float | None = None
    ) -> None:
        self._spec = spec
        self._air_c = air_c
        self._streams = streams
        self._normals = NORMALS[spec.noise_source]
        self._schedule = Schedule.at(spec.rate_hz)
        self._orientation_stddev = math.radians(spec.orientation_stddev_deg)
        triads = (spec.accelerometer, spec.gyroscope)
        self._white = _six([t.noise_density * math.sqrt(TICK_RATE_HZ) for t in triads])
        self._constant = _six([t.turn_on_bias for t in triads]) * self._of_the_run("turn_on_bias")
        wandering = _six([t.bias_instability / PEAK_OF_GAUSS_MARKOV for t in triads])
        self._processes = ErrorProcesses(
            streams,
            "bias",
            stddevs=np.concatenate([wandering, _six([t.random_walk for t in triads])]),
            time_constants_s=[*_six([t.bias_time_constant_s for t in triads]), *[math.inf] * 6],
            noise_source=spec.noise_source,
        )
        self._bias_per_k = _six([t.bias_per_k for t in triads]) * self._of_the_run("bias_per_k")
        self._scale_per_k = _six([t.scale_per_k for t in triads]) * self._of_the_run("scale_per_k")
        self._calibrated = [
            self._axes(spec.accelerometer, "accelerometer"),
            self._axes(spec.gyroscope, "gyroscope"),
        ]
        self._force_axes, self._rate_axes = self._calibrated
        by_force = self._of_the_run("g_sensitivity", 9).reshape(3, 3)
        self._rate_by_force = (spec.gyroscope.g_sensitivity * by_force).tolist()
        self._block = self._orientation_block = -1
        self._rows: list[Six] = []
        self._turns: list[Vector3] = []

    def measured(self, force: Vector3, rate: Vector3, tick: int) -> Six:
        """Apply the errors to a tick's specific force (m/s^2) and angular rate (rad/s)."""
        block, row = divmod(tick, BLOCK_TICKS)
        if block != self._block:
            errors, self._block = self.added(block), block
            if self._air_c is not None:
                warmer_k = self.temperature_c(block * BLOCK_TICKS, self._air_c) - CALIBRATED_C
                errors += self._bias_per_k * warmer_k
                scales = 1 + self._scale_per_k.reshape(2, 3, 1) * warmer_k
                self._force_axes, self._rate_axes = (scales * self._calibrated).tolist()
            self._rows = errors.tolist()
        added = self._rows[row]
        fx, fy, fz = force
        rx, ry, rz = rate
        felt = [xx * fx + xy * fy + xz * fz for xx, xy, xz in self._force_axes]
        felt += [
            xx * rx + xy * ry + xz * rz + gx * fx + gy * fy + gz * fz
            for (xx, xy, xz), (gx, gy, gz) in zip(self._rate_axes, self._rate_by_force, strict=True)
        ]
        return [value + error for value, error in zip(felt, added, strict=True)]

    def temperature_c(self, tick: int, air_c: float) -> float:
        """Return the sensor's temperature; at tick 0 it is that of the air."""
        spec = self._spec
        return air_c - spec.self_heating_k * math.expm1(-tick * TICK_SECONDS / spec.warm_up_s)

    def added(self, block: int) -> NDArray[np.float64]:
        """Return the additive errors of the 128 ticks from 128 block on, shape (128, 6)."""
        generator = self._streams.at("white", block * BLOCK_TICKS)
        white = self._normals(generator).draw(BLOCK_TICKS * 6).reshape(-1, 6) * self._white
        bias = self._processes.block(block)
        return white + bias[:, :6] + bias[:, 6:] + self._constant

    def turn(self, index: int) -> Vector3:
        """Return the orientation error of sample `index`: rotation vector in rad, sensor frame."""
        block, row = divmod(index, BLOCK_SAMPLES)
        if block != self._orientation_block:
            # Samples are at least a tick apart, so no two blocks begin at the same tick.
            tick = self._schedule.tick(block * BLOCK_SAMPLES)
            normal = self._normals(self._streams.at("orientation", tick)).draw(BLOCK_SAMPLES * 3)
            turns = normal.reshape(-1, 3) * self._orientation_stddev
            self._turns = [(x, y, z) for x, y, z in turns.tolist()]
            self._orientation_block = block
        return self._turns[row]

    def _of_the_run(self, purpose: str, count: int = 6) -> NDArray[np.float64]:
        return self._normals(self._streams.at(purpose, 0)).draw(count)

    def _axes(self, noise: InertialNoise, triad: str) -> list[Six]:
        """Return the rows of the matrix from true values to the values along the three axes."""
        drawn = self._of_the_run(f"{triad}_axes", 9).reshape(3, 3)
        sigma = np.full((3, 3), math.radians(noise.misalignment_deg))
        np.fill_diagonal(sigma, noise.scale_factor)
        rows: list[Six] = (np.eye(3) + drawn * sigma).tolist()
        return rows


def _six(of_triads: list[float]) -> NDArray[np.float64]:
    return np.repeat(np.asarray(of_triads, np.float64), 3)
