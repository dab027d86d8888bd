# SPDX-License-Identifier: Apache-2.0
"""Memory of a gateway: what a successor, or a restored run, continues from.

It is part of the gateway's acknowledgements. Datagrams on the wire or in the emulated link are not.
"""

from collections.abc import Callable

import msgspec
from msgspec.structs import replace

from groundlink.emulation.model import DirectionState
from groundlink.messages.base import Ack

from .emulated_socket import EmulatedSocket
from .gateway import Gateway


class _Memory(msgspec.Struct, array_like=True):
    newest: dict[str, int]
    """By stream: stamp of the newest message that was sent to ROS."""

    counts: dict[str, int]
    link: dict[str, DirectionState]
    """By direction: state of the emulated link's random numbers."""

    next_due: dict[str, int] = {}
    not_come: dict[str, int] = {}
    """See `MissingReadingCounter.memory`."""


class GatewayMemory:
    """Packs and restores the memory of a gateway and its emulated link."""

    def __init__(
        self, gateway: Gateway, emulated: EmulatedSocket | None, publish: Callable[[Ack], object]
    ) -> None:
        self._gateway, self._emulated, self._publish = gateway, emulated, publish

    def acknowledge(self, ack: Ack) -> None:
        """Publish an acknowledgement with the memory."""
        self._publish(replace(ack, memory=self.pack()))

    def pack(self) -> bytes:
        """Return the memory."""
        gateway, emulated = self._gateway, self._emulated
        link = {} if emulated is None else emulated.direction_states()
        missing = gateway.missing_readings.memory()
        return msgspec.msgpack.encode(_Memory(gateway.newest, gateway.counts, link, *missing))

    def recall(self, memory: bytes) -> None:
        """Continue from a predecessor's memory, after the first clock of an episode."""
        if not memory:
            return
        known = msgspec.msgpack.decode(memory, type=_Memory)
        self._gateway.newest = known.newest
        self._gateway.counts |= known.counts
        self._gateway.missing_readings.remember(known.next_due, known.not_come)
        if self._emulated is not None:
            self._emulated.restore(known.link)
