# SPDX-License-Identifier: Apache-2.0
"""From velocity commands to the speed that each wheel is asked for.

Rule: pure; sim time comes in. A command acts in the step that begins at its stamp or after it,
until a newer one does or it is older than the drive's timeout. How fast a wheel really turns is up
to its motor and the ground.
"""

from __future__ import annotations

from bisect import insort
from math import isfinite

from groundlink.clock import NANOS, TICK_SECONDS
from groundlink.messages import Command
from groundlink.scenario.vehicle import VehicleModel

MAX_WAITING = 1000
"""Commands that may wait for their instant; more means that a sender's clock is wrong."""

Speeds = tuple[float, ...]
Twist = tuple[float, float]
"""Velocity along the base's x, m/s, and about its z, rad/s."""

STANDSTILL: Twist = (0.0, 0.0)


class SkidSteering:
    """The drive of one vehicle.

    Parameters
    ----------
    model
        whose wheels and limits count.
    epoch_nanos
        stamp of sim time zero.
    """

    def __init__(self, model: VehicleModel, *, epoch_nanos: int = 0) -> None:
        self._model = model
        self._epoch_nanos = epoch_nanos
        self._timeout_nanos = round(model.drive.command_timeout_s * NANOS)
        self._waiting: list[tuple[int, Twist]] = []
        self._since_nanos = -1
        self._asked = self._ramped = STANDSTILL
        self._speeds = wheel_speeds(model, STANDSTILL)

    def command(self, command: Command) -> None:
        """Take a command; one that is older than what acts already changes nothing.

        Raises
        ------
        ValueError
            when a number in it is not finite, or too many wait for their instant.
        """
        if not all(map(isfinite, (*command.linear_mps, *command.angular_radps))):
            raise ValueError("a velocity that is not a finite number")
        if len(self._waiting) >= MAX_WAITING:
            raise ValueError(f"{MAX_WAITING} commands wait already: their stamps are in the future")
        sim_nanos = command.stamp_nanos - self._epoch_nanos
        if sim_nanos >= self._since_nanos:
            twist = within_limits(self._model, (command.linear_mps[0], command.angular_radps[2]))
            insort(self._waiting, (sim_nanos, twist), key=lambda waiting: waiting[0])

    def speeds(self, sim_nanos: int) -> Speeds:
        """Return what each wheel is asked for in the tick from `sim_nanos`, rad/s, forward > 0.

        To be called once a tick: the velocity changes by what the drive's accelerations allow.
        """
        while self._waiting and self._waiting[0][0] <= sim_nanos:
            self._since_nanos, self._asked = self._waiting.pop(0)
        if sim_nanos - self._since_nanos > self._timeout_nanos:
            self._asked = STANDSTILL
        if self._ramped != self._asked:
            drive = self._model.drive
            (v, w), (asked_v, asked_w) = self._ramped, self._asked
            self._ramped = (
                _towards(v, asked_v, drive.max_acceleration_mps2 * TICK_SECONDS),
                _towards(w, asked_w, drive.max_angular_acceleration_radps2 * TICK_SECONDS),
            )
            self._speeds = wheel_speeds(self._model, within_limits(self._model, self._ramped))
        return self._speeds


def within_limits(model: VehicleModel, twist: Twist) -> Twist:
    """Return a velocity for which no wheel turns too fast: slower, but on the same curve."""
    fastest = max(map(abs, wheel_speeds(model, twist)))
    share = min(1.0, model.drive.max_wheel_speed_radps / fastest) if fastest else 1.0
    return twist[0] * share, twist[1] * share


def wheel_speeds(model: VehicleModel, twist: Twist) -> Speeds:
    """Return the speed of each wheel, rad/s, in the model's order, for a velocity of the base.

    Wheels roll with v - w y k, with k the track multiplier: a skid-steered vehicle turns slower
    than its geometry says, since its wheels slip sideways.
    """
    linear_mps, angular_radps = twist
    k = model.drive.track_multiplier
    return tuple(
        (linear_mps - angular_radps * wheel.center_m[1] * k) / wheel.radius_m
        for wheel in model.wheels
    )


def _towards(value: float, target: float, most: float) -> float:
    """Return `value` moved to `target`, by no more than `most`."""
    return value + max(-most, min(most, target - value))
