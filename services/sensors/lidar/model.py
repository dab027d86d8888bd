# SPDX-License-Identifier: Apache-2.0
"""A spinning LiDAR: states of the world in, one cloud for each revolution out.

Rule: revolution i covers the sim time from i / rate to (i + 1) / rate and is measured when the
state at or after its end has come. Each ray leaves from the sensor's pose at its own instant and
meets all vehicles, its own too, as they stand at that instant. A point is in the sensor's frame at
its ray's instant: what a driver publishes that does not undo the motion.

A surface nearer than the least range gives no return and hides what is behind it. There is one
return a ray, of no width; weather and range do not weaken it.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from groundlink.clock import NANOS, TICK_NANOS, Schedule
from groundlink.messages import POINT, BadMessage, PointCloud, State, packed
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Lidar
from services.sensors.rays.kernels import kernels
from services.sensors.rays.replica import Replica
from services.sensors.rays.scene import Hits, Reals
from services.sensors.streams import RandomStreams

from .sweep import Sweep


class LidarModel:
    """One LiDAR of a scenario's vehicle.

    Raises
    ------
    UserError
        when the data sheet's lists are not of one length.
    EngineUnavailableError, KernelsMissingError
        when Embree or the compiled loops are not installed here; both are `UserError`s.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Lidar) -> None:
        self._spec = spec
        self._frame = vehicle.frame_prefix + spec.frame
        self._sweep = Sweep(spec)
        self._replica = Replica(scenario, vehicle, spec.mount.xyz_m)
        self._streams = RandomStreams(scenario.seed, f"{vehicle.name}/{spec.name}")
        self._schedule = Schedule.at(spec.rotation_rate_hz)
        lasers = len(self._sweep.rings)
        bias = self._streams.at("bias", 0).uniform(-spec.laser_bias_m, spec.laser_bias_m, lasers)
        self._bias_m: Reals = bias[self._sweep.rings, None].astype(np.float32)
        self._seconds: Reals = self._sweep.seconds.astype(np.float32)
        self.restart()

    def restart(self) -> None:
        """Forget earlier states; the next revolution is the first that begins after this."""
        self._replica.restart()
        self._revolution = self._tick = self._end_tick = -1

    def readings(self, state: State) -> list[PointCloud]:
        """Take the state of the next tick and return the revolution that it completes, if any.

        Raises
        ------
        BadMessage
            when the state lacks a vehicle or a link of the scenario; the model is then restarted.
        """
        try:
            self._replica.take(state)
        except BadMessage:
            self.restart()
            raise
        self._tick = state.tick
        if self._revolution < 0:
            self._begin(self._schedule.first_at_or_after(state.tick))
        if state.tick < self._end_tick:
            return []
        cloud = self._measured(self._revolution, state.epoch_nanos)
        self._begin(self._revolution + 1)
        return [cloud]

    def _begin(self, revolution: int) -> None:
        self._revolution = revolution
        self._end_tick = self._schedule.tick(revolution + 1)
        self._replica.forget(self._first_tick(revolution))

    def settled_tick(self) -> int:
        """Return the tick at which the revolution under way began; -1 before the first state."""
        if self._revolution < 0:
            return -1
        return min(self._tick, self._first_tick(self._revolution))

    def _first_tick(self, revolution: int) -> int:
        """Return the last tick that is not after the start of a revolution."""
        return self._schedule.nanos(revolution) // TICK_NANOS

    def _measured(self, revolution: int, epoch_nanos: int) -> PointCloud:
        start_nanos, first_tick = self._schedule.nanos(revolution), self._first_tick(revolution)
        poses = self._replica.motion(first_tick, self._end_tick)
        start_seconds = (start_nanos - first_tick * TICK_NANOS) / NANOS
        sweep, scene = self._sweep, self._replica.scene
        sweep.follow(poses[:, self._replica.base], start_seconds)
        scene.move(poses)
        hits = scene.cast(
            sweep.origins_in_world, sweep.directions_in_world, sweep.times, self._spec.max_range_m
        )
        range_m, returned = self._noisy(hits.range_m, self._schedule.tick(revolution))
        points = self._points(range_m, returned, hits)
        return PointCloud(epoch_nanos + start_nanos, self._frame, points)

    def _noisy(self, range_m: Reals, tick: int) -> tuple[Reals, NDArray[np.bool_]]:
        """Return the ranges that the device measures and which of them it reports.

        White noise, the laser's own error, rounding, loss, in this order. Every ray draws, whether
        it returned or not, so that what one ray meets does not change another's noise.
        """
        spec = self._spec
        if spec.range_stddev_m:
            noise = self._streams.at("range", tick)
            white = noise.standard_normal(range_m.shape, np.float32)
            range_m = range_m + np.float32(spec.range_stddev_m) * white
        range_m = range_m + self._bias_m
        if spec.range_resolution_m:
            step = np.float32(spec.range_resolution_m)
            range_m = np.rint(range_m / step) * step
        returned = (range_m >= spec.min_range_m) & (range_m <= spec.max_range_m)
        if spec.dropout:
            lost = self._streams.at("dropout", tick).random(range_m.shape, np.float32)
            returned &= lost >= spec.dropout
        return range_m, returned

    def _points(self, range_m: Reals, returned: NDArray[np.bool_], hits: Hits) -> memoryview:
        """Return `POINT` records of the returns, firing after firing, lasers as they fire.

        A point is range times direction above the laser's origin. Its intensity is the calibrated
        reflectivity byte, 100 rho cos(incidence) for a diffuse surface; 101..255 is for
        retroreflectors (VLP-16 User Manual 63-9243, calibrated reflectivities).
        """
        sweep = self._sweep
        points = np.empty(np.count_nonzero(returned), POINT)
        arrays = (
            *(sweep.rings, self._seconds, range_m, returned, sweep.directions_in_world),
            *(hits.normal_in_world, hits.label, self._replica.reflectivity, points),
        )
        kernels().groundlink_points(
            ctypes.byref(sweep.head), *(array.ctypes.data for array in arrays)
        )
        return packed(points.view(np.uint8))
