# SPDX-License-Identifier: Apache-2.0
"""Timing of camera pictures: one picture per schedule event, with late pictures left out.

The exposure of picture i begins at event i of the rate's schedule. If the next picture is already
due according to the number of waiting states, the picture is left out and reported as missing.
Otherwise the camera would stay late. Subclasses draw the pictures.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Protocol

from groundlink.core.clock import TICK_NANOS, Schedule
from groundlink.messages.base import BadBusMessage, BusMessage, State
from groundlink.scenario.cameras import Optics

from .model import LeftOut, Made, StreamMessage
from .next_event import NextEvent


class Watcher(Protocol):
    """Buffer of states, for pictures at instants between ticks."""

    def restart(self) -> None:
        """Forget all states."""

    def take(self, state: State) -> None:
        """Store the next state."""


class PictureModel(ABC):
    """Timing of a camera (a `SkippingModel`); subclasses provide the pictures.

    Parameters
    ----------
    span_nanos : int
        Duration of an exposure. The picture is taken once all of the exposure's states are known.
    """

    def __init__(self, spec: Optics, watcher: Watcher, *, span_nanos: int = 0) -> None:
        self._schedule = Schedule.at(spec.rate_hz)
        self._due = NextEvent(self._schedule)
        self._watcher = watcher
        self._waiting = 0
        self._span_ticks = -(-span_nanos // TICK_NANOS)
        self._taken = 0

    def restart(self) -> None:
        """Forget earlier states. Called after a jump in time or a loss of states."""
        self._watcher.restart()
        self._due.restart()
        self._taken = 0

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._due.tick

    def behind(self, waiting: int) -> None:
        """Report, before each state, how many further states have arrived."""
        self._waiting = waiting

    def readings(self, state: State) -> Sequence[Made]:
        """Return the messages of the picture that the next tick's state completes, if any.

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
            return []  # an exposure that ends now began before the first known state
        event = self._due.by(state.tick - self._span_ticks)
        if event is None:
            return []
        next_tick = self._schedule.tick(event.number + 1)
        if next_tick + self._span_ticks <= state.tick + self._waiting:
            return [LeftOut(event.nanos, "overloaded")]
        return self.taken(event.nanos, event.tick, state.epoch_nanos + event.nanos)

    @abstractmethod
    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[BusMessage | StreamMessage]:
        """Return the messages of a picture; `tick` is the first tick at or after its instant."""
