# SPDX-License-Identifier: Apache-2.0
"""Interfaces of sensor models, which turn states into readings.

A model reads no clock, bus or socket. It receives every state in order and without a gap since its
construction or its last `restart`.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol, runtime_checkable

from groundlink.messages.base import BusMessage, State
from groundlink.messages.missing_readings import Cause


class StreamMessage(NamedTuple):
    """A message of a stream other than the sensor's main one."""

    output: str
    """Name of the stream, as in `SensorSpec.ros_topics`."""

    message: BusMessage


class LeftOut(NamedTuple):
    """Placeholder for a reading that was due and that the sensor left out."""

    nanos: int
    """Sim time of the omitted reading's stamp."""

    cause: Cause
    output: str | None = None
    """Name of the stream that lacks the reading; None for all streams of the sensor."""


Made = BusMessage | StreamMessage | LeftOut
"""Output of a sensor for one state."""


def stream_and_message(made: BusMessage | StreamMessage) -> tuple[str, BusMessage]:
    """Return the stream name (empty for the main stream) and the message of an output."""
    return made if isinstance(made, StreamMessage) else ("", made)


class SensorModel(Protocol):
    """Interface of a sensor model, without the process around it."""

    def restart(self) -> None:
        """Forget earlier states. Called after a jump in time or a loss of states."""

    def readings(self, state: State) -> Iterable[Made]:
        """Take the state of the next tick and yield the readings that it completes, oldest first.

        A plain message belongs to the sensor's main stream. A sensor with ground truth enabled
        yields the ground truth after each reading.
        """

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""


@runtime_checkable
class RememberingModel(SensorModel, Protocol):
    """Sensor whose readings depend on more than the states, such as a counter with missed ticks."""

    def memory(self) -> bytes:
        """Return the memory for a successor whose first state is that of `settled_tick`."""

    def remember(self, memory: bytes) -> None:
        """Restore a predecessor's memory; empty memory resets to the initial condition."""


class RemovedSensor:
    """Model of a sensor whose vehicle was removed from the world; it yields no readings."""

    def __init__(self) -> None:
        self._tick = -1

    def restart(self) -> None:
        """Ignore the call; there is no state to forget."""

    def readings(self, state: State) -> Iterable[BusMessage | StreamMessage]:
        """Yield no readings."""
        self._tick = state.tick
        return ()

    def settled_tick(self) -> int:
        """Return the last tick."""
        return self._tick


@runtime_checkable
class SkippingModel(SensorModel, Protocol):
    """Sensor with expensive measurements, which may leave out late readings and report them."""

    def behind(self, waiting: int) -> None:
        """Report, before each state, how many further states have arrived.

        Without these calls, the sensor produces every reading, however late.
        """


class Datagram(NamedTuple):
    """UDP datagram in the device's own format."""

    payload: bytes
    port: int | None = None
    """Port, if it differs from the user's port."""


class NativeDevice(Protocol):
    """Emulation of the device's own network interface."""

    def datagrams(self, reading: Any, epoch_nanos: int) -> Iterable[Datagram]:
        """Return the datagrams for a published reading; `epoch_nanos` is the epoch of the run."""


@runtime_checkable
class PortDevice(NativeDevice, Protocol):
    """Device whose receivers check the port that datagrams come from."""

    source_port: int


@runtime_checkable
class ModelDevice(NativeDevice, Protocol):
    """Device whose datagrams say more of a reading than its message does, as its model knows it."""

    def follow(self, model: Any) -> None:
        """Use another model, that of a changed world."""
