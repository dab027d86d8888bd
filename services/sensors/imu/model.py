# SPDX-License-Identifier: Apache-2.0
"""IMU model (section 3.3.3 of the paper), at any rate up to the engine's 400 Hz.

The stamp of sample i is event i of the rate's schedule. The sample is the mean over the interval
since event i-1, in the sensor's own frame. Integration instead of sampling prevents aliasing of
vibrations above the rate. The window runs from stamp to stamp in whole nanoseconds; ticks at its
ends count by their share. Errors apply to ticks in this order: axes, noise and biases, then the low
pass, then the limits of each axis. The mean is taken last and is then rounded. The orientation is
that at the stamp, the end of the window, and is not filtered.

Force and rate of tick k are both centered at state k-1 (`motion.py`), because a value in the middle
of the tick would need the state after k. Both are therefore centered at the same instant: half a
tick (1.25 ms) before the middle of the window, at every rate. Without errors, a reading times the
difference of stamps is the change of the engine's velocity and of the orientation half a tick
before the stamps. This is exact at 400 Hz, and exact at any rate while the sensor does not turn.
Otherwise it holds to second order in the angle turned within a window.

A sample is published by the first tick at or after its stamp. Sample 0 has no window. The first
published sample is the first whose window began after two states were received and the low pass was
full.
"""

import math
from functools import lru_cache

import numpy as np

from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, Schedule
from groundlink.core.quaternions import from_rotation_vector, multiply
from groundlink.messages import base as messages
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.random_streams import RandomStreams

from .errors import ImuErrors
from .lowpass import Six, low_pass, weights
from .motion import SensorMotion, TickMotion
from .spec import InertialNoise, InertialUnit


class Window:
    """Averaging interval of a sample, between two stamps."""

    def __init__(self, schedule: Schedule, index: int) -> None:
        self.index = index
        self.begin_nanos = schedule.nanos(index - 1)
        self.end_nanos = schedule.nanos(index)
        self.end_tick = schedule.tick(index)
        self._sums = [0.0] * 6
        self._shares: list[float] = []

    def add(self, values: Six, tick: int) -> None:
        """Add the part of (tick-1, tick] that lies within the window."""
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
        """Return the share of each tick within the window, oldest first."""
        return tuple(self._shares)


@lru_cache(maxsize=256)
def variance(noise: InertialNoise, shares: tuple[float, ...]) -> float:
    """Return a sample's variance from white noise and rounding, in the quantity's unit squared.

    Noise of density N has variance N^2 * 400 Hz in each tick. A sample is a weighted mean of the
    ticks in its window, each of which the low pass spreads over earlier ticks.
    """
    of_ticks = np.convolve(shares[::-1], weights(noise.bandwidth_hz)) / math.fsum(shares)
    white = noise.noise_density**2 * TICK_RATE_HZ * float((of_ticks**2).sum())
    return white + noise.resolution**2 / 12


class ImuModel:
    """IMU of a vehicle (a `SensorModel`).

    Reported variances are those of a sample's white errors and rounding. Biases and misalignment
    are constant over many samples, so the variance of one sample cannot express them. The estimator
    has to model them, as with a real device.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: InertialUnit) -> None:
        self._vehicle = vehicle.name
        self._frame = vehicle.frame_prefix + spec.frame
        self._mount, self._link = spec.mount, vehicle.model.link_of(spec.mount)
        self._schedule = Schedule.at(spec.rate_hz)
        streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")
        self._errors = ImuErrors(spec, streams, scenario.world.weather.temperature_c)
        self._orientation_variance = math.radians(spec.orientation_stddev_deg) ** 2
        self._triads = (spec.accelerometer, spec.gyroscope)
        self._limits = [t.saturation or math.inf for t in self._triads for _ in range(3)]
        self._resolutions = [t.resolution for t in self._triads for _ in range(3)]
        self.restart()

    def restart(self) -> None:
        """Forget earlier states. Called after a jump in time or a loss of states."""
        self._motion = SensorMotion(self._mount)
        self._filter = low_pass(*(triad.bandwidth_hz for triad in self._triads))
        self._window: Window | None = None
        self._tick = -1

    def settled_tick(self) -> int:
        """Return the tick whose state a successor must receive first.

        The successor then continues with the next sample. This is one tick before the current
        window began, because an acceleration needs three states, and earlier by the memory of the
        low pass; -1 before the first state.
        """
        if self._window is None:
            return -1
        return min(self._tick, self._window.begin_nanos // TICK_NANOS - self._filter.ticks)

    def readings(self, state: messages.State) -> list[messages.Imu]:
        """Return the sample that the next tick's state completes, if any.

        Raises
        ------
        BadBusMessage
            when the state lacks the vehicle's base.
        """
        vehicle = state.vehicles.get(self._vehicle)
        if vehicle is None or len(vehicle.poses()) <= self._link:
            name = self._vehicle
            raise messages.BadBusMessage(f"state of tick {state.tick}: no link poses of `{name}`")
        window = self._window
        if window is None:
            # Motion is known from the tick after next on, so without a low pass the window may
            # begin at the next tick.
            first_start = self._schedule.first_at_or_after(state.tick + self._filter.ticks)
            window = self._window = Window(self._schedule, first_start + 1)
        motion = self._motion.advance(vehicle.poses()[self._link].tolist())
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
        """Return the sample of a complete window that ends within `motion`, with its errors."""
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
