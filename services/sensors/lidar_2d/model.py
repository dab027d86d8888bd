# SPDX-License-Identifier: Apache-2.0
"""Planar scanner model: turn states of the world into one scan per revolution or block.

The scanner decides what is measured and when; this module converts returns into ranges. Rays are in
order of time, as the device measures them. The stamp is therefore that of the first ray, and the
time increment is exact. For a head that turns clockwise, the angle increment is negative.

A range is in the sensor's frame at the instant of its ray, without motion compensation. Values
follow REP 117: -inf below the minimum range, +inf without a return. A scanner cannot distinguish a
lost echo from no echo, so there is no NaN.
"""

import math

import numpy as np

from groundlink.messages.base import State, packed
from groundlink.messages.imagery import LaserScan
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.runtime.model import LeftOut
from services.sensors.scanning.scanner import Scan, Scanner
from services.sensors.scanning.sweep import SIGNS, Sweep

from .spec import Lidar2d


class Lidar2dModel:
    """Planar scanner of a vehicle (a `SkippingModel`).

    Raises
    ------
    KernelsMissingError
        when the compiled loops are not installed; a `UserError`.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Lidar2d) -> None:
        self._spec = spec
        self._frame = vehicle.frame_prefix + spec.frame
        self._scanner = Scanner(scenario, vehicle, spec, Sweep(spec))
        self.restart, self.behind = self._scanner.restart, self._scanner.behind
        self.settled_tick = self._scanner.settled_tick
        self._step_rad = SIGNS[spec.rotation] * 2 * math.pi / spec.firings_per_revolution

    def readings(self, state: State) -> list[LaserScan | LeftOut]:
        """Take the state of the next tick and return the readings that it completes, oldest first.

        Raises
        ------
        BadBusMessage
            when the state lacks a vehicle or a link of the scenario; the model is then restarted.
        """
        return [
            scan if isinstance(scan, LeftOut) else self._message(scan, state.epoch_nanos)
            for scan in self._scanner.take(state)
        ]

    def _message(self, scan: Scan, epoch_nanos: int) -> LaserScan:
        spec, returns = self._spec, scan.returns
        only = 0, 0  # indices of return and laser
        range_m, returned = returns.range_m[only], returns.returned[only]
        near = range_m < spec.min_range_m
        nothing = np.where(near, np.float32(-np.inf), np.float32(np.inf))
        start_rad = math.radians(spec.start_deg)
        return LaserScan(
            stamp_nanos=epoch_nanos + scan.nanos,
            frame=self._frame,
            angle_min_rad=start_rad + scan.firings.start * self._step_rad,
            angle_increment_rad=self._step_rad,
            time_increment_s=1 / (spec.rotation_rate_hz * spec.firings_per_revolution),
            scan_time_s=1 / spec.rotation_rate_hz,
            min_range_m=spec.min_range_m,
            max_range_m=spec.max_range_m,
            ranges_m=packed(np.where(returned, range_m, nothing)),
            intensities=packed(np.where(returned, returns.intensity[only], np.float32(0))),
        )
