# SPDX-License-Identifier: Apache-2.0
"""Errors of GNSS fixes: white noise, slow drift and velocity noise.

An error is a function of the seed, the sensor's name and the number of the fix; it does not depend
on the start time of the process. Random numbers are drawn for every fix, including lost ones.
"""

from typing import NamedTuple

from groundlink.core.clock import Schedule
from groundlink.core.fields import Vector3
from groundlink.scenario.sensors import Gnss
from services.sensors.noise.error_processes import BLOCK_TICKS, ErrorProcesses
from services.sensors.noise.normal import PolarNormal
from services.sensors.noise.random_streams import RandomStreams


class FixErrors(NamedTuple):
    """Errors of one fix along east, north and up, under an open sky."""

    position_m: Vector3
    velocity_mps: Vector3


class GnssErrors:
    """Error model of a receiver."""

    def __init__(self, spec: Gnss, streams: RandomStreams) -> None:
        self._streams = streams
        self._schedule = Schedule.at(spec.rate_hz)
        axes = (spec.horizontal, spec.horizontal, spec.vertical)
        self._white = [axis.white_stddev_m for axis in axes]
        self._velocity = spec.velocity_stddev_mps
        self._drift = ErrorProcesses(
            streams,
            "drift",
            stddevs=[axis.drift_stddev_m for axis in axes],
            time_constants_s=[spec.drift_time_s] * 3,
            noise_source="marsaglia",
        )
        self.variances_m2 = [axis.white_stddev_m**2 + axis.drift_stddev_m**2 for axis in axes]

    def of_fix(self, index: int) -> FixErrors:
        """Return the errors of fix `index`."""
        tick = self._schedule.tick(index)
        normal = PolarNormal(self._streams.at("white", tick)).draw(6).tolist()
        block, row = divmod(tick, BLOCK_TICKS)
        drift = self._drift.block(block)[row].tolist()
        east, north, up = (
            sigma * number + slow
            for sigma, number, slow in zip(self._white, normal[:3], drift, strict=True)
        )
        ve, vn, vu = (self._velocity * number for number in normal[3:])
        return FixErrors((east, north, up), (ve, vn, vu))
