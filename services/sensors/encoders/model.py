# SPDX-License-Identifier: Apache-2.0
"""Wheel encoder model: 64-bit counters, read at the motor controller's rate.

This module decides when the counters are read. `services.sensors.runtime.wheel_counters` defines
the counts. The stamp of a reading is its schedule event, and the counts are those of that instant.
"""

from groundlink.core.clock import TICK_NANOS, Schedule
from groundlink.messages import base as messages
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.runtime.next_event import NextEvent
from services.sensors.runtime.wheel_counters import WheelCounters

from .spec import Encoders


class EncodersModel:
    """Wheel encoders of a vehicle (a `RememberingModel`)."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Encoders) -> None:
        self._frame = vehicle.frame_prefix + spec.frame
        self._due = NextEvent(Schedule.at(spec.rate_hz))
        self._counters = WheelCounters(scenario, vehicle, spec)
        self.memory, self.remember = self._counters.memory, self._counters.remember
        self.restart()

    def restart(self) -> None:
        """Forget earlier states. Called after a jump in time or a loss of states."""
        self._due.restart()
        self._counters.restart()

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first.

        A successor that receives the state of this tick first continues with the next reading.
        """
        return self._due.tick

    def readings(self, state: messages.State) -> list[messages.WheelEncoders]:
        """Return the reading that the next tick's state completes, if any.

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
