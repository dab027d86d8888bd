# SPDX-License-Identifier: Apache-2.0
"""Interfaces of sensor models: states in, readings out.

A model reads no clock, bus or socket. It gets every state in order, without a gap since its
construction or its last `restart`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol, runtime_checkable

from groundlink.messages.base import BusMessage, State
from groundlink.messages.missing_readings import Cause


class StreamMessage(NamedTuple):
    """A message of a stream other than the sensor's main one."""

    output: str
    """Name of its stream, as in `SensorSpec.ros_topics`."""

    message: BusMessage


class LeftOut(NamedTuple):
    """Stands in the place of a reading that was due and does not come."""

    nanos: int
    """Sim time of its stamp."""

    cause: Cause
    output: str | None = None
    """The stream that lacks it; None for all streams of the sensor."""


Made = BusMessage | StreamMessage | LeftOut
"""What a sensor makes of a state."""


def stream_and_message(made: BusMessage | StreamMessage) -> tuple[str, BusMessage]:
    """Return what a sensor made as the name of its stream, empty for the main one, and message."""
    return made if isinstance(made, StreamMessage) else ("", made)


class SensorModel(Protocol):
    """A sensor, without its process."""

    def restart(self) -> None:
        """Forget earlier states: time jumped or states were lost."""

    def readings(self, state: State) -> Iterable[Made]:
        """Take the state of the next tick and yield what can be measured by it, oldest first.

        A plain message belongs to the sensor's main stream. A sensor that was asked for its truth
        yields it behind each reading.
        """

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""


@runtime_checkable
class RememberingModel(SensorModel, Protocol):
    """A sensor with a past that states do not tell: a counter that has missed ticks."""

    def memory(self) -> bytes:
        """Return what a successor has to know that sees the state of `settled_tick` first."""

    def remember(self, memory: bytes) -> None:
        """Go on from a predecessor's memory; from an empty one, begin anew."""


class RemovedSensor:
    """Model of a sensor whose vehicle was removed from the world: it measures nothing."""

    def __init__(self) -> None:
        self._tick = -1

    def restart(self) -> None:
        """Do nothing."""

    def readings(self, state: State) -> Iterable[BusMessage | StreamMessage]:
        """Yield nothing."""
        self._tick = state.tick
        return ()

    def settled_tick(self) -> int:
        """Return the last tick."""
        return self._tick


@runtime_checkable
class SkippingModel(SensorModel, Protocol):
    """A sensor whose measurements are dear: what would come late it can leave out, and says so."""

    def behind(self, waiting: int) -> None:
        """Take note, before each state, of how many more have arrived.

        Of who is never told so everything comes, however late.
        """


class Datagram(NamedTuple):
    """What goes out by UDP in the device's own form."""

    payload: bytes
    port: int | None = None
    """Where it does not go to the port that the user names."""


class NativeDevice(Protocol):
    """The device behind a sensor, as it would send its readings itself."""

    def datagrams(self, reading: Any, epoch_nanos: int) -> Iterable[Datagram]:
        """Return what goes out with a reading, as it is published in a run of this epoch."""
