# SPDX-License-Identifier: Apache-2.0
"""Ride of a vehicle over roughness and treads, and the vibration of its engine.

What is finer than the ground's geometry lifts wheels against the body without moving them: their
springs and dampers feel the lift. The mass of a wheel does not follow it.
"""

from collections.abc import Sequence
from math import cos, exp, tau

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.vehicle import MAX_SHAKE_HZ, Engine, Tread
from groundlink.world.roughness import RoughGround
from services.physics.running_gear.running_gear import IN_AIR, RollingWheel

FADE_S = 2.0
"""Time constant in which a step of the lift fades, where ground begins or its material changes."""

FADE = exp(-TICK_SECONDS / FADE_S)


class WheelLift:
    """Lift of one wheel by the ground under it; continuous, zero at first."""

    MEMORY = ("_offset_m", "_roughness", "lift_m")

    __slots__ = MEMORY

    def __init__(self) -> None:
        self._roughness = IN_AIR
        self.lift_m = self._offset_m = 0.0

    def follow(self, roughness: float, ground_m: float) -> float:
        """Advance by a tick; return the speed of the lift, m/s.

        Parameters
        ----------
        roughness
            of the ground under the wheel, or `IN_AIR`.
        ground_m
            height of the ground's roughness and of the tread.
        """
        before = self.lift_m
        if roughness != self._roughness:
            self._roughness = roughness
            self._offset_m = before - ground_m
        else:
            self._offset_m *= FADE
        self.lift_m = ground_m + self._offset_m
        return (self.lift_m - before) / TICK_SECONDS


class Ride:
    """Lifts of all wheels of a vehicle."""

    def __init__(
        self, wheels: Sequence[RollingWheel], ground: RoughGround | None, tread: Tread | None
    ) -> None:
        self._wheels = wheels
        self._ground = ground
        self._tread = tread
        self.lifts = [WheelLift() for _ in wheels]

    def follow(self, hubs: Sequence[tuple[float, float]]) -> None:
        """Lift the wheels as the body feels them in this tick; forget what they touch.

        Parameters
        ----------
        hubs
            places of the wheels in the world, x and y.
        """
        for wheel, lift, hub in zip(self._wheels, self.lifts, hubs, strict=True):
            height, under = 0.0, wheel.under
            if under > 0.0 and self._ground:
                height = under * self._ground.height_m(*hub)
            if under >= 0.0 and self._tread and wheel.shaft:
                phase = (wheel.angle_rad * wheel.radius_m + wheel.center_m[0]) / self._tread.pitch_m
                height += self._tread.rise_m / 2 * cos(tau * phase)
            wheel.raised_mps = lift.follow(under, height)
            wheel.raised_m = lift.lift_m
            wheel.under = IN_AIR


class EngineShake:
    """Force of a running engine on the hull.

    Parameters
    ----------
    mass_kg
        of the whole vehicle.
    """

    MEMORY = ("_turns",)

    def __init__(self, engine: Engine, *, mass_kg: float, top_speed_mps: float) -> None:
        self._engine = engine
        self._mass_kg = mass_kg
        self._top_speed_mps = top_speed_mps
        self._turns = 0.0

    def force_n(self, speed_mps: float) -> float:
        """Advance by a tick; return the force along the base's z."""
        engine = self._engine
        share = min(abs(speed_mps) / self._top_speed_mps, 1.0)
        turns_hz = (engine.idle_rpm + share * (engine.max_rpm - engine.idle_rpm)) / 60
        self._turns += turns_hz * TICK_SECONDS
        of_most = (turns_hz * 60 / engine.max_rpm) ** 2
        return self._mass_kg * sum(
            of_most * order.acceleration_mps2 * cos(tau * order.order * self._turns)
            for order in engine.orders
            if order.order * turns_hz <= MAX_SHAKE_HZ
        )
