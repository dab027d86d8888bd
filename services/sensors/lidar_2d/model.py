# SPDX-License-Identifier: Apache-2.0
"""A planar scanner: states of the world in, one scan for each turn or block of it out.

Rule: what is measured, and when, is the scanner's business; here returns become ranges. Rays are in
the order of time, as the device measures them, so that the stamp is the first ray's and the time
increment is true; where the head turns clockwise, the angle increment is negative.

A range is in the sensor's frame at its ray's instant: motion is not undone. Values follow REP 117:
-inf for what is nearer than the least range, +inf where nothing comes back. A scanner does not tell
a lost echo from none, so there is no NaN.
"""

from __future__ import annotations

import math

import numpy as np

from groundlink.messages.base import State, packed
from groundlink.messages.imagery import LaserScan
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Lidar2d
from services.sensors.runtime.model import LeftOut
from services.sensors.scanning.scanner import Scan, Scanner
from services.sensors.scanning.sweep import SIGNS


class Lidar2dModel:
    """One planar scanner of a scenario's vehicle (a `SkippingModel`).

    Raises
    ------
    KernelsMissingError
        when the compiled loops are not installed here; a `UserError`.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Lidar2d) -> None:
        self._spec = spec
        self._frame = vehicle.frame_prefix + spec.frame
        self._scanner = Scanner(scenario, vehicle, spec)
        self._step_rad = SIGNS[spec.rotation] * 2 * math.pi / spec.firings_per_revolution

    def restart(self) -> None:
        """Forget earlier states; the next scan is the first that begins after this."""
        self._scanner.restart()

    def settled_tick(self) -> int:
        """Return the tick at which the scan under way began; -1 before the first state."""
        return self._scanner.settled_tick()

    def behind(self, waiting: int) -> None:
        """Take note, before each state, of how many more have arrived."""
        self._scanner.behind(waiting)

    def readings(self, state: State) -> list[LaserScan | LeftOut]:
        """Take the state of the next tick and return what it completes, oldest first.

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
        only = 0, 0  # return and laser
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
