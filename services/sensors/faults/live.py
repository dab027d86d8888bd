# SPDX-License-Identifier: Apache-2.0
"""Live faults: wraps a sensor's process, reports its faults and takes new ones during the run.

A live fault begins at the tick after the last one taken and is reported with that tick, so a
scenario with the fault from that tick on gives the same readings. Commands come on another thread;
no state is taken while one is executed.
"""

import threading
from collections.abc import Callable

import msgspec
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.episode.fault_messages import CLEAR, FaultAnswer, Faults
from groundlink.messages.base import Ack, State
from groundlink.process.state_follower import StateConsumer
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.faults import Fault
from groundlink.scenario.schema import Vehicle

from .fault_wrapper import FaultWrapper


class FaultRefused(ValueError):
    """A fault that the sensor cannot have; the text says why."""


def cleared(faults: tuple[Fault, ...], tick: int) -> tuple[Fault, ...]:
    """End the faults in effect at a tick; those that begin later stay."""
    left = []
    for fault in faults:
        lasted = tick - fault.begin_tick
        if not fault.is_on(tick):
            left.append(fault)
        elif lasted:
            left.append(replace(fault, for_s=lasted / TICK_RATE_HZ))
    return tuple(left)


class LiveFaults:
    """A sensor's process whose faults are reported and can be changed (a `StateConsumer`).

    Parameters
    ----------
    sensor, model
        the process, and the model in it.
    vehicle, spec
        their descriptions in the scenario.
    report
        publishes the faults in effect.
    acknowledge
        makes the process publish its progress and its model's memory at once.
    """

    def __init__(
        self,
        sensor: StateConsumer,
        model: FaultWrapper,
        *,
        vehicle: Vehicle,
        spec: SensorSpec,
        report: Callable[[Faults], object],
        acknowledge: Callable[[], object],
    ) -> None:
        self._sensor = sensor
        self._model = model
        self._vehicle = vehicle
        self._spec = spec
        self._report = report
        self._acknowledge = acknowledge
        self._turn = threading.Lock()
        self._episode: int | None = None
        self._reported: tuple[Fault, ...] | None = None

    @property
    def tick(self) -> int:
        """The last tick taken."""
        return self._sensor.tick

    @property
    def acknowledged_tick(self) -> int:
        """The last tick acknowledged."""
        return self._sensor.acknowledged_tick

    @property
    def active(self) -> tuple[Fault, ...]:
        """Faults in effect."""
        return self._model.active(self._sensor.tick)

    def resume(self, ack: Ack) -> None:
        """Resume where a predecessor or this process stopped, which has reported its faults.

        A predecessor that is this process in an earlier episode has reported later faults since.
        """
        with self._turn:
            self._sensor.resume(ack)
            has_reported = self._episode in (None, ack.episode)
            self._episode = ack.episode
            self._reported = self._model.active(ack.settled_tick) if has_reported else None

    def take(self, state: State, waiting: int = 0) -> None:
        """Take one state, in order; report changes. `waiting` more states have arrived."""
        with self._turn:
            self._sensor.take(state, waiting)
            if state.episode != self._episode:
                self._episode = state.episode
                # A process that joins a running episode may follow one that had faults.
                self._reported = None if state.tick else ()
            if self._sensor.tick == state.tick and self.active != self._reported:
                self._reported = self.active
                name = f"{self._vehicle.name}/{self._spec.name}"
                self._report(Faults(state.stamp_nanos, name, state.tick, self._reported))

    def answer(self, command: str) -> list[bytes]:
        """Execute a query's command (none, `CLEAR` or a fault in JSON); return a `FaultAnswer`."""
        with self._turn:
            tick = self._sensor.tick + 1
            try:
                if not tick:
                    raise FaultRefused("the sensor has received no state yet. Fix: try again")
                if command:
                    self._change(command, tick)
                    self._acknowledge()
                answer = FaultAnswer("", tick, self._model.active(tick))
            except (FaultRefused, msgspec.DecodeError) as error:
                answer = FaultAnswer(str(error))
        return [msgspec.json.encode(answer)]

    def _change(self, command: str, tick: int) -> None:
        model = self._model
        if command == CLEAR:
            model.faults = cleared(model.faults, tick)
            return
        fault = msgspec.json.decode(command, type=Fault)
        if found := fault_problem(fault, self._spec, self._vehicle):
            raise FaultRefused(f"`{found[0]}`: {found[1]}")
        model.faults = (*model.faults, replace(fault, at_s=tick / TICK_RATE_HZ))
