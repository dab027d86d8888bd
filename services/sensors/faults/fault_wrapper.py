# SPDX-License-Identifier: Apache-2.0
"""A sensor model that can have faults, around one that has none.

Rule: a model as any other (a `RememberingModel`). What it is given beyond a scenario, and what it
holds, goes with its memory, so that a successor goes on with the same bytes; readings that are held
up are not settled, and are made again. What is not a `Reading`, the truth, no fault can reach.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, cast

import msgspec

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Message, Reading, State, decode, encode, measured_nanos
from groundlink.scenario.faults import Delay, Fault
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.runtime.model import (
    Beside,
    Gone,
    LeftOut,
    Made,
    RememberingModel,
    SensorModel,
    SkippingModel,
    parted,
)

from .effects import Removed, apply_faults
from .fault_context import FaultContext, FaultHistory


class _Memory(msgspec.Struct, array_like=True):
    """What the states do not tell."""

    inner: bytes
    faults: tuple[Fault, ...] | None
    """All of them, where they are others than the scenario's."""

    held: dict[str, dict[int, bytes]]
    events: dict[str, dict[int, int]]


class _Point(NamedTuple):
    """A state of the model to which a successor can go back."""

    settled_tick: int
    inner_memory: bytes
    pasts: dict[str, FaultHistory]


class _Late(NamedTuple):
    """A reading on its way."""

    due_tick: int
    made: Made
    before: _Point
    """From where a successor makes it again."""


class FaultWrapper:
    """A sensor with faults (a `RememberingModel`).

    Parameters
    ----------
    inner
        The sensor.
    faults
        Those of the scenario.
    messages
        What its readings are, by stream.
    streams
        Random numbers of the sensor.
    """

    def __init__(
        self,
        inner: SensorModel,
        *,
        faults: tuple[Fault, ...],
        messages: Mapping[str, type[Message]],
        streams: RandomStreams,
    ) -> None:
        self._hold(inner)
        self._messages = messages
        self._of_scenario = faults
        self._streams = streams
        self.remember(b"")

    def renew(self, inner: SensorModel) -> None:
        """Go on with another sensor, which knows what the one before remembers."""
        if isinstance(self._inner, RememberingModel) and isinstance(inner, RememberingModel):
            inner.remember(self._inner.memory())
        self._hold(inner)

    def _hold(self, inner: SensorModel) -> None:
        self._inner = inner
        # Asked once and not at every state, as it is in the shell.
        self._skipping = inner if isinstance(inner, SkippingModel) else None

    @property
    def has_gone(self) -> bool:
        """Whether there is no sensor any more."""
        return isinstance(self._inner, Gone)

    def restart(self) -> None:
        """Forget earlier states; what is on its way still comes."""
        self._inner.restart()

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._late[0].before.settled_tick if self._late else self._inner.settled_tick()

    def memory(self) -> bytes:
        """Return what a successor has to know that sees the state of `settled_tick` first."""
        now = self._late[0].before if self._late else self._now()
        changed = None if self.faults is self._of_scenario else self.faults
        held = {
            output: {tick: encode(reading) for tick, reading in past.held.items()}
            for output, past in now.pasts.items()
        }
        events = {output: past.events for output, past in now.pasts.items()}
        return msgspec.msgpack.encode(_Memory(now.inner_memory, changed, held, events))

    def remember(self, memory: bytes) -> None:
        """Go on from a predecessor's memory; from an empty one, begin anew."""
        known = _Memory(b"", None, {}, {})
        if memory:
            known = msgspec.msgpack.decode(memory, type=_Memory)
        self.faults = self._of_scenario if known.faults is None else known.faults
        """All of them, past, present and to come; one that is added must begin after the last
        state."""

        self._pasts = {output: FaultHistory({}, events) for output, events in known.events.items()}
        for output, held in known.held.items():
            for tick, body in held.items():
                reading = decode(body, self._messages[output])
                self._pasts[output].held[tick] = cast(Reading, reading)
        self._late: deque[_Late] = deque()
        if isinstance(self._inner, RememberingModel):
            self._inner.remember(known.inner)

    def behind(self, waiting: int) -> None:
        """Take note, before each state, of how many more have arrived."""
        if self._skipping is not None:
            self._skipping.behind(waiting)

    def active(self, tick: int) -> tuple[Fault, ...]:
        """Return the faults that are in effect at a tick."""
        return tuple(fault for fault in self.faults if fault.is_on(tick))

    def readings(self, state: State) -> Iterable[Made]:
        """Take the state of the next tick and yield what comes out by it, oldest first."""
        if not self.faults:
            return self._inner.readings(state)
        before = self._now() if self._may_be_late(state.tick) else None
        out: list[Made] = []
        for made in self._inner.readings(state):
            changed, late_ticks = self._apply(made, state.epoch_nanos)
            if changed is None:
                out.append(made)
            elif before is not None and (late_ticks or self._late):
                self._late.append(_Late(state.tick + late_ticks, changed, before))
            else:
                out.append(changed)
        # Nothing overtakes: what comes late holds up what is behind it.
        while self._late and self._late[0].due_tick <= state.tick:
            out.append(self._late.popleft().made)
        return out

    def _apply(self, made: Made, epoch_nanos: int) -> tuple[Made | None, int]:
        """Return what becomes of a reading and how late; nothing of what no fault can reach."""
        if isinstance(made, LeftOut):
            return made, 0
        output, message = parted(made)
        if not isinstance(message, Reading):
            return None, 0
        sim_nanos = measured_nanos(message) - epoch_nanos
        now = self._context(output, sim_nanos)
        reading = apply_faults(now, message)
        if isinstance(reading, Removed):
            return LeftOut(sim_nanos, reading.by, output), now.late_ticks
        return Beside(output, reading) if output else reading, now.late_ticks

    def _context(self, output: str, sim_nanos: int) -> FaultContext:
        faults = self.active(sim_nanos // TICK_NANOS)
        past = self._pasts.get(output, FaultHistory({}, {})).of(faults)
        # A new dictionary: the one before may belong to a point to go back to.
        self._pasts = self._pasts | {output: past}
        return FaultContext(faults, sim_nanos, self._streams, past)

    def _may_be_late(self, tick: int) -> bool:
        begins = (fault.begin_tick for fault in self.faults if isinstance(fault, Delay))
        return bool(self._late) or any(begin <= tick for begin in begins)

    def _now(self) -> _Point:
        inner: Any = self._inner
        memory = inner.memory() if isinstance(inner, RememberingModel) else b""
        return _Point(inner.settled_tick(), memory, self._pasts)
