# SPDX-License-Identifier: Apache-2.0
"""The inertial measurement unit: the paper's 3.3.3, at any rate up to the engine's 400 Hz.

Rule: sample i is stamped with event i of the rate's schedule and is the mean over the interval
since event i-1, in the sensor's own frame: what was felt is integrated, not picked, so that shaking
faster than the rate does not fold into the readings. The window runs from stamp to stamp in whole
nanoseconds; ticks that it cuts count by their share. Errors belong to ticks: axes, noise and
biases, then the low pass and the limits of each axis, then the mean, which is what gets rounded.
The orientation is that at the stamp, the end of the window, and passes no filter.

Force and rate of tick k are both centered at state k-1 (`motion.py`), as the state after k, which a
value in the middle of the tick would take, is not there yet. So both are centered at the same
instant: half a tick (1.25 ms) before the middle of the window, at every rate. Without errors,
reading times the difference of stamps is the change of the engine's velocity and of the orientation
half a tick before the stamps: exactly so at 400 Hz, at any rate while the sensor does not turn, and
to the second order of the angle turned within a window otherwise.

A sample is published by the first tick at or after its stamp. Sample 0 has no window; the first one
out is the first whose window began after two states were seen and the low pass was full.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, Schedule
from groundlink.core.quaternions import from_rotation_vector, multiply
from groundlink.messages import base as messages
from groundlink.scenario import sensors
from groundlink.scenario.inertial import InertialNoise
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.random_streams import RandomStreams

from .errors import ImuErrors
from .lowpass import Six, low_pass, weights
from .motion import SensorMotion, TickMotion


class Window:
    """The interval between two stamps over which a sample is the mean."""

    def __init__(self, schedule: Schedule, index: int) -> None:
        self.index = index
        self.begin_nanos = schedule.nanos(index - 1)
        self.end_nanos = schedule.nanos(index)
        self.end_tick = schedule.tick(index)
        self._sums = [0.0] * 6
        self._shares: list[float] = []

    def add(self, values: Six, tick: int) -> None:
        """Count the part of (tick-1, tick] that lies within the window."""
        tick_end = tick * TICK_NANOS
        inside = min(tick_end, self.end_nanos) - max(tick_end - TICK_NANOS, self.begin_nanos)
        if inside > 0:
            share = inside / TICK_NANOS
            pairs = zip(self._sums, values, strict=True)
            self._sums = [total + share * now for total, now in pairs]
            self._shares.append(share)

    def mean(self) -> list[float]:
        """Return the mean specific force (m/s^2) and angular rate (rad/s), six floats."""
        ticks = math.fsum(self._shares)
        return [total / ticks for total in self._sums]

    def shares(self) -> tuple[float, ...]:
        """Return how much of each tick, oldest first, lies within the window."""
        return tuple(self._shares)


@lru_cache(maxsize=256)
def variance(noise: InertialNoise, shares: tuple[float, ...]) -> float:
    """Return the variance of a sample by white noise and rounding, in the quantity's unit squared.

    Noise of density N has variance N^2 * 400 Hz in each tick, and a sample is a weighted mean of
    ticks: of those in its window, each spread over the ticks before it by the low pass.
    """
    of_ticks = np.convolve(shares[::-1], weights(noise.bandwidth_hz)) / math.fsum(shares)
    white = noise.noise_density**2 * TICK_RATE_HZ * float((of_ticks**2).sum())
    return white + noise.resolution**2 / 12


class ImuModel:
    """One IMU of one vehicle (a `SensorModel`).

    Reported variances are those of the white errors of one sample, and of its rounding. Biases and
    leaning axes are constant over many samples, which no variance of one can say; they are left to
    the estimator, as with a real device.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: sensors.InertialUnit) -> None:
        self._vehicle = vehicle.name
        self._frame = vehicle.frame_prefix + spec.frame
        self._mount = spec.mount
        self._schedule = Schedule.at(spec.rate_hz)
        streams = RandomStreams(scenario.seed, f"{vehicle.name}/{spec.name}")
        self._errors = ImuErrors(spec, streams)
        self._orientation_variance = math.radians(spec.orientation_stddev_deg) ** 2
        self._triads = (spec.accelerometer, spec.gyroscope)
        self._limits = [t.saturation or math.inf for t in self._triads for _ in range(3)]
        self._resolutions = [t.resolution for t in self._triads for _ in range(3)]
        self.restart()

    def restart(self) -> None:
        """Forget earlier states: time jumped or states were lost."""
        self._motion = SensorMotion(self._mount)
        self._filter = low_pass(*(triad.bandwidth_hz for triad in self._triads))
        self._window: Window | None = None
        self._tick = -1

    def settled_tick(self) -> int:
        """Return the tick whose state a successor must see first, to go on with the next sample.

        That is one tick before the window under way began, as it takes three states to see an
        acceleration, and as much earlier as the low pass remembers; -1 before the first state.
        """
        if self._window is None:
            return -1
        return min(self._tick, self._window.begin_nanos // TICK_NANOS - self._filter.ticks)

    def readings(self, state: messages.State) -> list[messages.Imu]:
        """Return the sample that the next tick's state completes, if there is one.

        Raises
        ------
        BadBusMessage
            when the state lacks the vehicle's base.
        """
        vehicle = state.vehicles.get(self._vehicle)
        if vehicle is None or not len(vehicle.link_poses):
            name = self._vehicle
            raise messages.BadBusMessage(f"state of tick {state.tick}: no link poses of `{name}`")
        window = self._window
        if window is None:
            # Motion is known from the tick after next on, so that without a low pass the window may
            # begin at the next tick.
            first_start = self._schedule.first_at_or_after(state.tick + self._filter.ticks)
            window = self._window = Window(self._schedule, first_start + 1)
        motion = self._motion.advance(vehicle.poses()[0].tolist())
        self._tick = state.tick
        if motion is None:
            return []
        felt = self._errors.measured(
            motion.specific_force_mps2, motion.angular_rate_radps, state.tick
        )
        values = self._filter.filtered(felt)
        if values is None:
            return []
        values = [max(-most, min(most, x)) for x, most in zip(values, self._limits, strict=True)]
        window.add(values, state.tick)
        if state.tick < window.end_tick:
            return []
        self._window = Window(self._schedule, window.index + 1)
        self._window.add(values, state.tick)
        return [self._sample(window, motion, state)]

    def _sample(self, window: Window, motion: TickMotion, state: messages.State) -> messages.Imu:
        """Return a finished window's sample, with its errors; it ends within `motion`."""
        fx, fy, fz, rx, ry, rz = map(_rounded, window.mean(), self._resolutions)
        fraction = 1.0 + (window.end_nanos - state.tick * TICK_NANOS) / TICK_NANOS
        turned = from_rotation_vector(self._errors.turn(window.index))
        accelerometer, gyroscope = self._triads
        return messages.Imu(
            stamp_nanos=state.epoch_nanos + window.end_nanos,
            frame=self._frame,
            orientation=multiply(motion.orientation_at(fraction), turned),
            angular_velocity_radps=(rx, ry, rz),
            linear_acceleration_mps2=(fx, fy, fz),
            orientation_variance=self._orientation_variance,
            angular_velocity_variance=variance(gyroscope, window.shares()),
            linear_acceleration_variance=variance(accelerometer, window.shares()),
        )


def _rounded(value: float, resolution: float) -> float:
    return round(value / resolution) * resolution if resolution else value
