# SPDX-License-Identifier: Apache-2.0
"""A spinning LiDAR: states of the world in, one cloud for each revolution or block of it out.

Rule: revolution i covers the sim time from i / rate to (i + 1) / rate and is measured when the
state at or after its end has come; in blocks each block is, when the state after its last ray has
come, and the blocks together are what the revolution would have been. Each ray leaves from the
sensor's pose at its own instant and meets all vehicles, its own too, as they stand at that instant.
A point is in the sensor's frame at its ray's instant: what a driver publishes that does not undo
the motion.

A surface nearer than the least range gives no return and hides what is behind it. There is one
return a ray, of no width; weather and range do not weaken it.
"""

from __future__ import annotations

import ctypes
from typing import NamedTuple

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

from .blocks import Blocks
from .sweep import Sweep


class _Draws(NamedTuple):
    """The random numbers of a revolution, shape (lasers, firings); None where none are needed."""

    revolution: int
    white: Reals | None
    lost: Reals | None


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
        self._blocks = Blocks(spec, self._sweep)
        self._seconds: Reals = self._blocks.since_start(self._sweep.seconds)
        self.restart()

    def restart(self) -> None:
        """Forget earlier states; the next block is the first that begins after this."""
        self._replica.restart()
        self._block = self._tick = -1
        self._drawn: _Draws | None = None

    def readings(self, state: State) -> list[PointCloud]:
        """Take the state of the next tick and return what it completes, oldest first.

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
        if self._block < 0:
            self._begin(self._blocks.first_at_or_after(state.tick))
        clouds = []
        while self._blocks.end_tick(self._block) <= state.tick:
            end = self._blocks.complete_by(state.tick, self._block)
            clouds += self._measured(range(self._block, end), state.epoch_nanos)
            self._begin(end)
        return clouds

    def _begin(self, block: int) -> None:
        self._block = block
        self._replica.forget(self._blocks.first_tick(block))

    def settled_tick(self) -> int:
        """Return the tick at which the block under way began; -1 before the first state."""
        if self._block < 0:
            return -1
        return min(self._tick, self._blocks.first_tick(self._block))

    def _measured(self, blocks: range, epoch_nanos: int) -> list[PointCloud]:
        """Return the clouds of some blocks of one revolution, whose rays are cast at once."""
        revolution, firings = self._blocks.firings(blocks)
        start_nanos = self._schedule.nanos(revolution)
        first_tick = start_nanos // TICK_NANOS
        # States of the whole revolution, so that an instant is the same number in every block.
        poses = self._replica.motion(first_tick, self._schedule.tick(revolution + 1))
        start_seconds = (start_nanos - first_tick * TICK_NANOS) / NANOS
        sweep, scene, asked = self._sweep, self._replica.scene, slice(firings.start, firings.stop)
        sweep.follow(poses[:, self._replica.base], start_seconds, firings)
        scene.move(poses)
        hits = scene.cast(
            sweep.origins_in_world[..., asked],
            sweep.directions_in_world[..., asked],
            sweep.times[:, asked],
            self._spec.max_range_m,
        )
        range_m, returned = self._noisy(hits.range_m, self._draws(revolution), asked)
        points = self._points(range_m, returned, hits, firings)
        clouds, before = [], 0
        for block in blocks:
            _, own = self._blocks.firings(range(block, block + 1))
            of_block = returned[:, own.start - firings.start : own.stop - firings.start]
            after = before + int(np.count_nonzero(of_block))
            stamp_nanos = epoch_nanos + self._blocks.nanos(block)
            clouds.append(PointCloud(stamp_nanos, self._frame, packed(points[before:after])))
            before = after
        return clouds

    def _draws(self, revolution: int) -> _Draws:
        """Return what the rays of a revolution draw, whatever block they are in."""
        if self._drawn is None or self._drawn.revolution != revolution:
            tick, shape = self._schedule.tick(revolution), self._sweep.seconds.shape
            white = lost = None
            if self._spec.range_stddev_m:
                white = self._streams.at("range", tick).standard_normal(shape, np.float32)
            if self._spec.dropout:
                lost = self._streams.at("dropout", tick).random(shape, np.float32)
            self._drawn = _Draws(revolution, white, lost)
        return self._drawn

    def _noisy(
        self, range_m: Reals, draws: _Draws, firings: slice
    ) -> tuple[Reals, NDArray[np.bool_]]:
        """Return the ranges that the device measures and which of them it reports.

        White noise, the laser's own error, rounding, loss, in this order. Every ray draws, whether
        it returned or not, so that what one ray meets does not change another's noise.
        """
        spec = self._spec
        if draws.white is not None:
            range_m = range_m + np.float32(spec.range_stddev_m) * draws.white[:, firings]
        range_m = range_m + self._bias_m
        if spec.range_resolution_m:
            step = np.float32(spec.range_resolution_m)
            range_m = np.rint(range_m / step) * step
        returned = (range_m >= spec.min_range_m) & (range_m <= spec.max_range_m)
        if draws.lost is not None:
            returned &= draws.lost[:, firings] >= spec.dropout
        return range_m, returned

    def _points(
        self, range_m: Reals, returned: NDArray[np.bool_], hits: Hits, firings: range
    ) -> NDArray[np.void]:
        """Return `POINT` records of the returns, firing after firing, lasers as they fire.

        A point is range times direction above the laser's origin. Its intensity is the calibrated
        reflectivity byte, 100 rho cos(incidence) for a diffuse surface; 101..255 is for
        retroreflectors (VLP-16 User Manual 63-9243, calibrated reflectivities).
        """
        sweep = self._sweep
        points = np.empty(np.count_nonzero(returned), POINT)
        arrays = (
            *(sweep.rings, self._seconds, sweep.directions_in_world),
            *(range_m, returned, hits.normal_in_world, hits.label),
            *(self._replica.reflectivity, points),
        )
        kernels().groundlink_points(
            *(ctypes.byref(sweep.head), firings.start, firings.stop),
            *(array.ctypes.data for array in arrays),
        )
        return points
