# SPDX-License-Identifier: Apache-2.0
"""Recordings at rest of Groundlink's own IMU and satellite receiver, without a process."""

import numpy as np

from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, Schedule
from groundlink.fitting.series import Reals, Series
from services.sensors.gnss.model import GnssErrors
from services.sensors.gnss.spec import Gnss
from services.sensors.imu.errors import ImuErrors
from services.sensors.imu.lowpass import weights
from services.sensors.imu.motion import STANDARD_GRAVITY_MPS2
from services.sensors.imu.spec import InertialUnit
from services.sensors.noise.error_processes import BLOCK_TICKS
from services.sensors.noise.random_streams import RandomStreams


def imu_at_rest(spec: InertialUnit, seconds: float, *, seed: int = 1) -> Series:
    """Return the readings of a level IMU: specific force in m/s^2, angular rate in rad/s.

    They are those of `ImuModel`, computed for all ticks at once.
    """
    errors = ImuErrors(spec, RandomStreams(seed, "rover/imu"))
    ticks = round(seconds * TICK_RATE_HZ) + 1
    blocks = -(-ticks // BLOCK_TICKS)
    added = np.concatenate([errors.added(block) for block in range(blocks)])[:ticks]
    still = (0.0, 0.0, STANDARD_GRAVITY_MPS2), (0.0, 0.0, 0.0)
    felt = added + (np.array(errors.measured(*still, 0)) - added[0])
    for number, triad in enumerate((spec.accelerometer, spec.gyroscope)):
        axes, taps = slice(3 * number, 3 * number + 3), weights(triad.bandwidth_hz)
        for axis in range(3 * number, 3 * number + 3):
            felt[:, axis] = np.convolve(felt[:, axis], taps)[: len(felt)]
        most = triad.saturation or np.inf
        felt[:, axes] = np.clip(felt[:, axes], -most, most)
    schedule = Schedule.at(spec.rate_hz)
    # The first samples contain the settling of the low pass.
    settled = max(spec.accelerometer.low_pass_ticks, spec.gyroscope.low_pass_ticks)
    first = schedule.first_at_or_after(settled)
    last = schedule.first_at_or_after(len(felt) - 1)
    ends = np.array([schedule.nanos(i) for i in range(first, last)]) / TICK_NANOS
    readings = np.stack([_means(felt[:, axis], ends) for axis in range(6)], axis=1)
    for number, triad in enumerate((spec.accelerometer, spec.gyroscope)):
        if triad.resolution:
            axes = slice(3 * number, 3 * number + 3)
            readings[:, axes] = np.rint(readings[:, axes] / triad.resolution) * triad.resolution
    return Series([readings], 1 / spec.rate_hz)


def _means(values: Reals, ends: Reals) -> Reals:
    """Return the means between times in ticks, of values from tick - 1 to tick."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    reached = np.interp(ends, np.arange(-1, len(values)), sums)
    means: Reals = np.diff(reached) / np.diff(ends)
    return means


def receiver_at_rest(spec: Gnss, seconds: float, *, seed: int = 1) -> Series:
    """Return the errors of a receiver with the sheet's own errors: east, north, up in meters."""
    errors = GnssErrors(spec, RandomStreams(seed, "rover/gnss"))
    fixes = [errors.of_fix(i).position_m for i in range(round(seconds * spec.rate_hz))]
    return Series([np.array(fixes)], 1 / spec.rate_hz)
