# SPDX-License-Identifier: Apache-2.0
"""Steering geometry: from a velocity of the base to shaft speeds and steering angles.

One class each for skid steering, for Ackermann steering and for wheels with rollers. The actual
speed of a shaft depends on its motor and on the ground.
"""

from collections.abc import Sequence
from math import atan, copysign, hypot, tan

import numpy as np

from groundlink.scenario.running_gear import Ackermann, Omnidirectional, SideSteered, Towed
from groundlink.scenario.vehicle import VehicleModel

Speeds = tuple[float, ...]
"""Speeds of the driven shafts, rad/s, forward > 0."""

Twist = tuple[float, ...]
"""Velocity along the base's x, m/s, about its z, rad/s, and along its y, m/s, of a base that drives
sideways."""

STANDSTILL: Twist = (0.0, 0.0)

LEAST_M = 1e-9
"""Instead of no distance, by which nothing can be divided."""


class SkidSteering:
    """Shafts roll at v - w y k, with k the track multiplier.

    A skidding vehicle turns more slowly than its geometry says.
    """

    MEMORY = ()
    STANDSTILL = STANDSTILL

    def __init__(self, model: VehicleModel, drive: SideSteered) -> None:
        wheels = model.wheels
        self._most = drive.max_wheel_speed_radps
        self._shares = [
            (drive.track_multiplier * wheels[shaft.wheels[0]].center_m[1], shaft.radius_m)
            for shaft in drive.shafts(wheels)
            if shaft.driven
        ]
        mean = sum(y for y, _ in self._shares) / len(self._shares)
        self._spread = sum((y - mean) ** 2 for y, _ in self._shares)

    def speeds(self, twist: Twist, angles: Sequence[float] = ()) -> Speeds:
        """Return the speed of each driven shaft for a velocity of the base."""
        linear, angular = twist[0], twist[1]
        return tuple([(linear - angular * y) / radius for y, radius in self._shares])

    def twist(self, speeds: Sequence[float], angles: Sequence[float] = ()) -> Twist:
        """Return the velocity of the base that shaft speeds amount to, in least squares."""
        rows = [
            (share, speed * radius)
            for speed, (share, radius) in zip(speeds, self._shares, strict=True)
        ]
        count = len(rows)
        y_mean, v_mean = sum(y for y, _ in rows) / count, sum(v for _, v in rows) / count
        angular = -sum((y - y_mean) * (v - v_mean) for y, v in rows) / self._spread
        return v_mean + angular * y_mean, angular

    def angles(self, twist: Twist) -> tuple[float, ...]:
        """Return the angles of the steered wheels: none."""
        return ()

    def within_limits(self, twist: Twist) -> Twist:
        """Return a velocity on the same curve that no shaft is too slow for."""
        fastest = max(map(abs, self.speeds(twist)))
        share = min(1.0, self._most / fastest) if fastest else 1.0
        return twist[0] * share, twist[1] * share


class AckermannSteering:
    """The axles of all wheels meet in one point on the line of those that are not steered.

    So tan(angle) = L / (R - y) for a wheel L before that line, y to the left. Driven wheels turn as
    the curve of the present steering angles demands, as a differential lets them. At standstill the
    angles are kept; a yaw rate counts only with a speed.
    """

    MEMORY = ("_curvature",)
    STANDSTILL = STANDSTILL

    def __init__(self, model: VehicleModel, drive: Ackermann) -> None:
        wheels = model.wheels
        pivot_x_m = drive.pivot_x_m(wheels)
        self._most = drive.max_wheel_speed_radps
        steered = {w.name: w.center_m for w in wheels if w.name in drive.steered}
        self._steered = [(x - pivot_x_m, y) for x, y, _ in (steered[n] for n in drive.steered)]
        self._most_curved = 1 / drive.least_radius_m(wheels)
        self._driven = [
            (center[0] - pivot_x_m, center[1], shaft.radius_m)
            for shaft in drive.shafts(wheels)
            if shaft.driven
            for center in (wheels[shaft.wheels[0]].center_m,)
        ]
        self._curvature = 0.0

    def speeds(self, twist: Twist, angles: Sequence[float] = ()) -> Speeds:
        """Return the speed of each driven wheel at the present steering angles."""
        curvature = self._curved_by(angles) if angles else self._curvature
        speeds = []
        for length, y, radius in self._driven:
            along = 1.0 - curvature * y
            speeds.append(twist[0] * copysign(hypot(along, curvature * length), along) / radius)
        return tuple(speeds)

    def twist(self, speeds: Sequence[float], angles: Sequence[float]) -> Twist:
        """Return the velocity of the base that wheel speeds amount to at steering angles."""
        curvature = self._curved_by(angles)
        linear = [
            speed
            * radius
            / copysign(hypot(1.0 - curvature * y, curvature * length), 1.0 - curvature * y)
            for speed, (length, y, radius) in zip(speeds, self._driven, strict=True)
        ]
        mean = sum(linear) / len(linear)
        return mean, curvature * mean

    def angles(self, twist: Twist) -> tuple[float, ...]:
        """Return the angle of each steered wheel for a velocity of the base."""
        if twist[0]:
            most = self._most_curved
            self._curvature = max(-most, min(most, twist[1] / twist[0]))
        k = self._curvature
        return tuple(atan(k * length / (1.0 - k * y)) for length, y in self._steered)

    def within_limits(self, twist: Twist) -> Twist:
        """Return a velocity on the same curve that is not too fast for the wheels straight on."""
        most = self._most * min(radius for _, _, radius in self._driven)
        share = min(1.0, most / abs(twist[0])) if twist[0] else 1.0
        return twist[0] * share, twist[1] * share

    def _curved_by(self, angles: Sequence[float]) -> float:
        """Return the mean curvature (1/m) of the steered wheels."""
        total = 0.0
        for (length, y), angle in zip(self._steered, angles, strict=True):
            slope = tan(angle)
            # A single wheel may be commanded to turn about the middle of the axle.
            total += slope / (length + y * slope or LEAST_M)
        return total / len(angles)


class OmnidirectionalSteering:
    """Each wheel rolls so that its grip moves as the base does there: see `Omnidirectional`."""

    MEMORY = ()
    STANDSTILL: Twist = (0.0, 0.0, 0.0)

    def __init__(self, model: VehicleModel, drive: Omnidirectional) -> None:
        self._most = drive.max_wheel_speed_radps
        self._rows = drive.rows(model.wheels)
        self._inverse = np.linalg.pinv(np.array(self._rows))

    def speeds(self, twist: Twist, angles: Sequence[float] = ()) -> Speeds:
        """Return the speed of each driven wheel for a velocity of the base."""
        forward, angular, left = twist
        return tuple([forward * x + left * y + angular * turn for x, y, turn in self._rows])

    def twist(self, speeds: Sequence[float], angles: Sequence[float] = ()) -> Twist:
        """Return the velocity of the base that wheel speeds amount to, in least squares."""
        forward, left, angular = (self._inverse @ np.array(speeds)).tolist()
        return forward, angular, left

    def angles(self, twist: Twist) -> tuple[float, ...]:
        """Return the angles of the steered wheels: none."""
        return ()

    def within_limits(self, twist: Twist) -> Twist:
        """Return a velocity in the same direction that no wheel is too slow for."""
        fastest = max(map(abs, self.speeds(twist)))
        share = min(1.0, self._most / fastest) if fastest else 1.0
        return tuple([part * share for part in twist])


class NoSteering:
    """Of a vehicle that is towed."""

    MEMORY = ()
    STANDSTILL = STANDSTILL

    def speeds(self, twist: Twist, angles: Sequence[float] = ()) -> Speeds:
        """Return no speeds."""
        return ()

    def twist(self, speeds: Sequence[float], angles: Sequence[float] = ()) -> Twist:
        """Return standstill."""
        return STANDSTILL

    def angles(self, twist: Twist) -> tuple[float, ...]:
        """Return no angles."""
        return ()

    def within_limits(self, twist: Twist) -> Twist:
        """Return standstill."""
        return STANDSTILL


Steering = SkidSteering | AckermannSteering | OmnidirectionalSteering | NoSteering


def steering(model: VehicleModel) -> Steering:
    """Return the steering geometry of a vehicle."""
    if isinstance(model.drive, Ackermann):
        return AckermannSteering(model, model.drive)
    if isinstance(model.drive, Towed):
        return NoSteering()
    if isinstance(model.drive, Omnidirectional):
        return OmnidirectionalSteering(model, model.drive)
    return SkidSteering(model, model.drive)
