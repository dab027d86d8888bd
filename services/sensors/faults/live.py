# SPDX-License-Identifier: Apache-2.0
"""Around a sensor's process: tells the run what faults begin and end, and takes live ones.

Rule: a live fault begins at the tick after the last one taken, and is told with that tick, so that
a scenario that has it from there on gives the same readings. Wishes come on another thread; while
one is done, no state is taken.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import msgspec
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.messages.base import Ack, State
from groundlink.messages.faults import CLEAR, FaultAnswer, Faults
from groundlink.process.state_follower import StateConsumer
from groundlink.scenario.fault_checks import fault_problem
from groundlink.scenario.faults import Fault
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.sensors import SensorSpec

from .fault_wrapper import FaultWrapper


class FaultRefused(ValueError):
    """A wish that cannot be done; the text says why."""


def cleared(faults: tuple[Fault, ...], tick: int) -> tuple[Fault, ...]:
    """Return faults of which none is in effect at a tick: what is to begin later stays."""
    left = []
    for fault in faults:
        lasted = tick - fault.begin_tick
        if not fault.is_on(tick):
            left.append(fault)
        elif lasted:
            left.append(replace(fault, for_s=lasted / TICK_RATE_HZ))
    return tuple(left)


class LiveFaults:
    """A sensor's process whose faults are told and can be changed (a `StateConsumer`).

    Parameters
    ----------
    sensor, model
        The process, and the model in it.
    vehicle, spec
        What the scenario says of them.
    report
        Publishes what is in effect.
    acknowledge
        Has the process tell its progress, and so what its model remembers, at once.
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
        self._life: int | None = None
        self._told: tuple[Fault, ...] | None = None

    @property
    def tick(self) -> int:
        """The last one taken."""
        return self._sensor.tick

    @property
    def acknowledged_tick(self) -> int:
        """The last one told to be taken."""
        return self._sensor.acknowledged_tick

    @property
    def active(self) -> tuple[Fault, ...]:
        """What is in effect."""
        return self._model.active(self._sensor.tick)

    def resume(self, ack: Ack) -> None:
        """Go on where a predecessor stopped, which has told what was in effect.

        Where that is this process itself in an earlier life, it has told of another time since.
        """
        with self._turn:
            self._sensor.resume(ack)
            has_told = self._life is None
            self._life = ack.life
            self._told = self._model.active(ack.settled_tick) if has_told else None

    def take(self, state: State, waiting: int = 0) -> None:
        """Take one state, in order; tell what has changed by it. So many more have arrived."""
        with self._turn:
            self._sensor.take(state, waiting)
            if state.life != self._life:
                self._life = state.life
                # Who joins a run under way may follow on one that had faults.
                self._told = None if state.tick else ()
            if self._sensor.tick == state.tick and self.active != self._told:
                self._told = self.active
                name = f"{self._vehicle.name}/{self._spec.name}"
                self._report(Faults(state.stamp_nanos, name, state.tick, self._told))

    def answer(self, wish: str) -> list[bytes]:
        """Do what a query says: nothing, `CLEAR` or a fault in JSON; reply a `FaultAnswer`."""
        with self._turn:
            tick = self._sensor.tick + 1
            try:
                if not tick:
                    raise FaultRefused("the sensor has seen no state yet; try again")
                if wish:
                    self._change(wish, tick)
                    self._acknowledge()
                answer = FaultAnswer("", tick, self._model.active(tick))
            except (FaultRefused, msgspec.DecodeError) as error:
                answer = FaultAnswer(str(error))
        return [msgspec.json.encode(answer)]

    def _change(self, wish: str, tick: int) -> None:
        model = self._model
        if wish == CLEAR:
            model.faults = cleared(model.faults, tick)
            return
        fault = msgspec.json.decode(wish, type=Fault)
        if found := fault_problem(fault, self._spec, self._vehicle):
            raise FaultRefused(f"`{found[0]}`: {found[1]}")
        model.faults = (*model.faults, replace(fault, at_s=tick / TICK_RATE_HZ))
