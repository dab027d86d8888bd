# SPDX-License-Identifier: Apache-2.0
"""Wheel encoders: 64-bit counters, read at the motor controller's rate.

Rule: this says when they are read; what they count is in `services.sensors.runtime.wheel_counters`.
A reading is stamped with its event of the schedule and has the counts of that very instant.
"""

from __future__ import annotations

from groundlink.core.clock import TICK_NANOS, Schedule
from groundlink.messages import base as messages
from groundlink.scenario import sensors
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.runtime.next_event import NextEvent
from services.sensors.runtime.wheel_counters import WheelCounters


class EncodersModel:
    """The encoders of one vehicle's wheels (a `RememberingModel`)."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: sensors.Encoders) -> None:
        self._frame = vehicle.frame_prefix + spec.frame
        self._due = NextEvent(Schedule.at(spec.rate_hz))
        self._counters = WheelCounters(scenario, vehicle, spec)
        self.restart()

    def restart(self) -> None:
        """Forget earlier states: time jumped or states were lost."""
        self._due.restart()
        self._counters.restart()

    def memory(self) -> bytes:
        """Return what a successor has to know that sees the state of `settled_tick` first."""
        return self._counters.memory()

    def remember(self, memory: bytes) -> None:
        """Go on from a predecessor's memory; from an empty one, begin anew."""
        self._counters.remember(memory)

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first.

        A successor that sees its state first goes on with the next reading.
        """
        return self._due.tick

    def readings(self, state: messages.State) -> list[messages.WheelEncoders]:
        """Return the reading that is due by the next tick's state, if there is one.

        Raises
        ------
        BadBusMessage
            when the state lacks a wheel of the vehicle.
        """
        self._counters.advance(state)
        event = self._due.by(state.tick)
        if event is None:
            return []
        return [
            messages.WheelEncoders(
                stamp_nanos=state.epoch_nanos + event.nanos,
                frame=self._frame,
                names=self._counters.names,
                ticks=self._counters.ticks(event.nanos - state.tick * TICK_NANOS),
            )
        ]
