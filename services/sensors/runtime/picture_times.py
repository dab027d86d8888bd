# SPDX-License-Identifier: Apache-2.0
"""When cameras take pictures: at the events of a rate, and none that would come late.

Rule: picture i shows the world at event i of the rate's schedule, or from then on for as long as it
is exposed. By what it is told of states that wait, a picture whose successor is due already is left
out and marked: what is late stays late otherwise. What is in a picture is its camera's business.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

from groundlink.core.clock import TICK_NANOS, Schedule
from groundlink.messages.base import BadBusMessage, BusMessage, State
from groundlink.scenario.sensors import Optics

from .model import LeftOut, Made, StreamMessage
from .next_event import NextEvent


class Watcher(Protocol):
    """What remembers states for the pictures of instants between them."""

    def restart(self) -> None:
        """Forget all states."""

    def take(self, state: State) -> None:
        """Remember the next state."""


class PictureModel(ABC):
    """A camera (a `SkippingModel`), but for its pictures.

    Parameters
    ----------
    span_nanos : int
        For how long after its event a picture is exposed: it is taken when all of that is known.
    """

    def __init__(self, spec: Optics, watcher: Watcher, *, span_nanos: int = 0) -> None:
        self._schedule = Schedule.at(spec.rate_hz)
        self._due = NextEvent(self._schedule)
        self._watcher = watcher
        self._waiting = 0
        self._span_ticks = -(-span_nanos // TICK_NANOS)
        self._taken = 0

    def restart(self) -> None:
        """Forget earlier states: time jumped or states were lost."""
        self._watcher.restart()
        self._due.restart()
        self._taken = 0

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._due.tick

    def behind(self, waiting: int) -> None:
        """Take note, before each state, of how many more have arrived."""
        self._waiting = waiting

    def readings(self, state: State) -> Sequence[Made]:
        """Return the picture that is due by the next tick's state, if there is one.

        Raises
        ------
        BadBusMessage
            when the state lacks a vehicle or a link of the scenario; the model is then restarted.
        """
        try:
            self._watcher.take(state)
        except BadBusMessage:
            self.restart()
            raise
        self._taken += 1
        if self._taken <= self._span_ticks:
            return []  # an exposure that ends by now has begun before what is known
        event = self._due.by(state.tick - self._span_ticks)
        if event is None:
            return []
        next_tick = self._schedule.tick(event.number + 1)
        if next_tick + self._span_ticks <= state.tick + self._waiting:
            return [LeftOut(event.nanos, "overloaded")]
        return self.taken(event.nanos, event.tick, state.epoch_nanos + event.nanos)

    @abstractmethod
    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[BusMessage | StreamMessage]:
        """Return the messages of the picture of an instant, the first of which is at `tick`."""
