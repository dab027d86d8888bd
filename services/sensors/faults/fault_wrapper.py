# SPDX-License-Identifier: Apache-2.0
"""Fault wrapper: applies faults to the readings of any sensor model.

It is a sensor model itself (a `RememberingModel`). Its memory includes live faults and held
readings, so a successor continues with the same bytes; delayed readings are not settled, and are
made again. Faults act on a `Reading` only, not on ground truth.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple, cast

import msgspec

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import BusMessage, Reading, State, decode, encode, measured_nanos
from groundlink.scenario.faults import Delay, Fault
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.runtime.model import (
    LeftOut,
    Made,
    RememberingModel,
    RemovedSensor,
    SensorModel,
    SkippingModel,
    StreamMessage,
    stream_and_message,
)

from .effects import FaultContext, FaultHistory, Removed, apply_faults


class _Memory(msgspec.Struct, array_like=True):
    """All that cannot be derived from states."""

    inner: bytes
    faults: tuple[Fault, ...] | None
    """All faults, if they differ from the scenario's."""

    held: dict[str, dict[int, bytes]]
    events: dict[str, dict[int, int]]


class _Point(NamedTuple):
    """A state of the model that a successor can resume from."""

    settled_tick: int
    inner_memory: bytes
    pasts: dict[str, FaultHistory]


class _Late(NamedTuple):
    """A delayed reading."""

    due_tick: int
    made: Made
    before: _Point
    """Where a successor resumes to make it again."""


class FaultWrapper:
    """A sensor with faults (a `RememberingModel`).

    Parameters
    ----------
    inner
        the sensor model.
    faults
        faults of the scenario.
    messages
        types of its readings, by stream.
    streams
        random streams of the sensor.
    """

    def __init__(
        self,
        inner: SensorModel,
        *,
        faults: tuple[Fault, ...],
        messages: Mapping[str, type[BusMessage]],
        streams: RandomStreams,
    ) -> None:
        self._hold(inner)
        self._messages = messages
        self._of_scenario = faults
        self._streams = streams
        self.remember(b"")

    def renew(self, inner: SensorModel) -> None:
        """Continue with another model, which gets the memory of the one before."""
        former = self._remembering
        self._hold(inner)
        if former is not None and self._remembering is not None:
            self._remembering.remember(former.memory())

    def _hold(self, inner: SensorModel) -> None:
        self._inner = inner
        # Checked once instead of at every state.
        self._skipping = inner if isinstance(inner, SkippingModel) else None
        self._remembering = inner if isinstance(inner, RememberingModel) else None

    @property
    def has_gone(self) -> bool:
        """Whether the sensor was removed."""
        return isinstance(self._inner, RemovedSensor)

    def restart(self) -> None:
        """Forget earlier states; delayed readings still come."""
        self._inner.restart()

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._late[0].before.settled_tick if self._late else self._inner.settled_tick()

    def memory(self) -> bytes:
        """Return the memory of a successor whose first state is that of `settled_tick`."""
        now = self._late[0].before if self._late else self._now()
        changed = None if self.faults is self._of_scenario else self.faults
        held = {
            output: {tick: encode(reading) for tick, reading in past.held.items()}
            for output, past in now.pasts.items()
        }
        events = {output: past.events for output, past in now.pasts.items()}
        return msgspec.msgpack.encode(_Memory(now.inner_memory, changed, held, events))

    def remember(self, memory: bytes) -> None:
        """Continue from a predecessor's memory; an empty one starts anew."""
        known = _Memory(b"", None, {}, {})
        if memory:
            known = msgspec.msgpack.decode(memory, type=_Memory)
        self.faults = self._of_scenario if known.faults is None else known.faults
        """All faults, past, present and future; an added one must begin after the last state."""

        self._pasts = {output: FaultHistory({}, events) for output, events in known.events.items()}
        for output, held in known.held.items():
            for tick, body in held.items():
                reading = decode(body, self._messages[output])
                self._pasts[output].held[tick] = cast(Reading, reading)
        self._late: deque[_Late] = deque()
        if self._remembering is not None:
            self._remembering.remember(known.inner)

    def behind(self, waiting: int) -> None:
        """Record, before each state, how many more states have arrived."""
        if self._skipping is not None:
            self._skipping.behind(waiting)

    def active(self, tick: int) -> tuple[Fault, ...]:
        """Return the faults that are in effect at a tick."""
        return tuple(fault for fault in self.faults if fault.is_on(tick))

    def readings(self, state: State) -> Iterable[Made]:
        """Take the state of the next tick; return its readings and delayed ones, oldest first."""
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
        # The order is kept: a delayed reading delays those behind it.
        while self._late and self._late[0].due_tick <= state.tick:
            out.append(self._late.popleft().made)
        return out

    def _apply(self, made: Made, epoch_nanos: int) -> tuple[Made | None, int]:
        """Return a reading after faults and its delay; None for ground truth."""
        if isinstance(made, LeftOut):
            return made, 0
        output, message = stream_and_message(made)
        if not isinstance(message, Reading):
            return None, 0
        sim_nanos = measured_nanos(message) - epoch_nanos
        now = self._context(output, sim_nanos)
        reading = apply_faults(now, message)
        if isinstance(reading, Removed):
            return LeftOut(sim_nanos, reading.by, output), now.late_ticks
        return StreamMessage(output, reading) if output else reading, now.late_ticks

    def _context(self, output: str, sim_nanos: int) -> FaultContext:
        faults = self.active(sim_nanos // TICK_NANOS)
        past = self._pasts.get(output, FaultHistory({}, {})).of(faults)
        # A new dictionary: a `_Point` may refer to the one before.
        self._pasts = self._pasts | {output: past}
        return FaultContext(faults, sim_nanos, self._streams, past)

    def _may_be_late(self, tick: int) -> bool:
        begins = (fault.begin_tick for fault in self.faults if isinstance(fault, Delay))
        return bool(self._late) or any(begin <= tick for begin in begins)

    def _now(self) -> _Point:
        memory = b"" if self._remembering is None else self._remembering.memory()
        return _Point(self._inner.settled_tick(), memory, self._pasts)
