# SPDX-License-Identifier: Apache-2.0
"""From the velocity of the base to the speed of each driven shaft and the angles of steered wheels.

Rule: pure geometry, one class for vehicles that their sides turn and one for those that steer. How
fast a shaft really turns is up to its motor and the ground.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan, copysign, hypot, tan

from groundlink.scenario.drives import Ackermann, SideSteered
from groundlink.scenario.vehicle import VehicleModel

Speeds = tuple[float, ...]
"""Of the driven shafts, rad/s, forward > 0."""

Twist = tuple[float, float]
"""Velocity along the base's x, m/s, and about its z, rad/s."""

STANDSTILL: Twist = (0.0, 0.0)


class SkidSteering:
    """Shafts roll with v - w y k, with k the track multiplier.

    A vehicle that skids round turns slower than its geometry says.
    """

    def __init__(self, model: VehicleModel, drive: SideSteered) -> None:
        wheels = model.wheels
        self._most = drive.max_wheel_speed_radps
        self._shares = [
            (drive.track_multiplier * wheels[shaft.wheels[0]].center_m[1], shaft.radius_m)
            for shaft in drive.shafts(wheels)
            if shaft.driven
        ]

    def speeds(self, twist: Twist, angles: Sequence[float] = ()) -> Speeds:
        """Return the speed of each driven shaft for a velocity of the base."""
        linear, angular = twist
        return tuple((linear - angular * y) / radius for y, radius in self._shares)

    def angles(self, twist: Twist) -> tuple[float, ...]:
        """Return the angles of the steered wheels: there are none."""
        return ()

    def within_limits(self, twist: Twist) -> Twist:
        """Return a velocity for which no shaft turns too fast: slower, but on the same curve."""
        fastest = max(map(abs, self.speeds(twist)))
        share = min(1.0, self._most / fastest) if fastest else 1.0
        return twist[0] * share, twist[1] * share


class AckermannSteering:
    """The axles of all wheels meet in one point on the line of those that are not steered.

    That is tan(angle) = L / (R - y) for a wheel L before that line, y to the left. Driven wheels
    turn as the curve demands on which the steered ones really are, as a differential lets them.
    Asked to stand still they keep their angles; the yaw rate counts where there is speed.
    """

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
        """Return the speed of each driven wheel, with the steered ones at their angles."""
        curvature = self._curved_by(angles) if angles else self._curvature
        speeds = []
        for length, y, radius in self._driven:
            along = 1.0 - curvature * y
            speeds.append(twist[0] * copysign(hypot(along, curvature * length), along) / radius)
        return tuple(speeds)

    def angles(self, twist: Twist) -> tuple[float, ...]:
        """Return the angle of each steered wheel for a velocity of the base."""
        if twist[0]:
            most = self._most_curved
            self._curvature = max(-most, min(most, twist[1] / twist[0]))
        k = self._curvature
        return tuple(atan(k * length / (1.0 - k * y)) for length, y in self._steered)

    def within_limits(self, twist: Twist) -> Twist:
        """Return a velocity that is not too fast for the wheels straight on; the same curve."""
        most = self._most * min(radius for _, _, radius in self._driven)
        share = min(1.0, most / abs(twist[0])) if twist[0] else 1.0
        return twist[0] * share, twist[1] * share

    def _curved_by(self, angles: Sequence[float]) -> float:
        """Return the curvature (1/m) that the steered wheels have in the mean."""
        total = 0.0
        for (length, y), angle in zip(self._steered, angles, strict=True):
            slope = tan(angle)
            total += slope / (length + y * slope)
        return total / len(angles)


Steering = SkidSteering | AckermannSteering


def steering(model: VehicleModel) -> Steering:
    """Return the geometry of a vehicle's drive."""
    if isinstance(model.drive, Ackermann):
        return AckermannSteering(model, model.drive)
    return SkidSteering(model, model.drive)
