# SPDX-License-Identifier: Apache-2.0
"""Wheel encoders: the paper's 3.3.4, 64-bit counters read at the motor controller's rate.

Rule: a counter is a function of its wheel's angle alone. The paper adds up differences of angle and
counts one up or down whenever they reach the encoder's resolution; joint angles never wrap, so the
sum of the differences is the angle itself, and the count is how many lines of the disc have gone
past. The lines stand still on the disc, as a real encoder's do: a line passed forward counts up and
the same line passed back counts down again. The first line is half a resolution away from angle
zero, so that a wheel at rest there does not flicker, both directions count alike, and a counter is
never further than half a tick from the angle. A restarted process therefore goes on with the very
same numbers and has nothing to remember. (The paper's rule starts anew at the last count, which
makes a backlash of one tick; the two differ by one tick at most.)

Missed ticks and resets are not modelled.
"""

from __future__ import annotations

import math

from groundlink import messages
from groundlink.clock import TICK_NANOS, Schedule
from groundlink.scenario import sensors
from groundlink.scenario.schema import Scenario, Vehicle


class EncodersModel:
    """The encoders of one vehicle's wheels (a `SensorModel`).

    A reading that falls between two ticks has the angles of its own instant, by linear
    interpolation: within a tick the engine turns a wheel at constant speed.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: sensors.Encoders) -> None:
        del scenario  # Nothing here is drawn at random.
        self._vehicle = vehicle.name
        self._names = tuple(wheel.name for wheel in vehicle.model.wheels)
        self._frame = vehicle.frame_prefix + spec.frame
        self._schedule = Schedule.at(spec.rate_hz)
        self._ticks_per_radian = spec.ticks_per_revolution / (2 * math.pi)
        self.restart()

    def restart(self) -> None:
        """Forget earlier states: time jumped or states were lost."""
        self._tick = -1
        self._index: int | None = None
        self._angles: list[float] = []

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first.

        A successor that sees its state first goes on with the next reading.
        """
        return self._tick

    def readings(self, state: messages.State) -> list[messages.WheelEncoders]:
        """Return the reading that is due by the next tick's state, if there is one.

        Raises
        ------
        BadMessage
            when the state lacks a wheel of the vehicle.
        """
        vehicle = state.vehicles.get(self._vehicle)
        angles = [] if vehicle is None else messages.floats(vehicle.joint_positions).tolist()
        if len(angles) != len(self._names):
            raise messages.BadMessage(
                f"state of tick {state.tick}: {len(angles)} joint positions of `{self._vehicle}`, "
                f"expected {len(self._names)}"
            )
        if self._index is None:
            self._index = self._schedule.first_at_or_after(state.tick)
            self._due_tick = self._schedule.tick(self._index)
        last, self._angles = self._angles, angles
        self._tick = state.tick
        if state.tick < self._due_tick:
            return []
        instant_nanos = self._schedule.nanos(self._index)
        self._index += 1
        self._due_tick = self._schedule.tick(self._index)
        return [
            messages.WheelEncoders(
                stamp_nanos=state.epoch_nanos + instant_nanos,
                frame=self._frame,
                names=self._names,
                ticks=self._count(last, instant_nanos - state.tick * TICK_NANOS),
            )
        ]

    def _count(self, last: list[float], lead_nanos: int) -> tuple[int, ...]:
        """Return the counters at `lead_nanos` (not above zero) from the tick just taken."""
        angles = self._angles
        if lead_nanos < 0:
            back = lead_nanos / TICK_NANOS
            angles = [now + back * (now - before) for before, now in zip(last, angles, strict=True)]
        return tuple(math.floor(angle * self._ticks_per_radian + 0.5) for angle in angles)
