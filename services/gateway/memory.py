# SPDX-License-Identifier: Apache-2.0
"""What a gateway remembers, so that one after it, or after a restore, goes on where it was.

Rule: it goes with the gateway's acknowledgements, as every process's memory does. What is on the
wire or waits in the emulated link belongs to the wall clock and is not in it.
"""

from __future__ import annotations

import msgspec

from groundlink.bus.core_topics import GATEWAY
from groundlink.bus.queries import history_key
from groundlink.bus.session import Bus
from groundlink.emulation.model import DirectionState
from groundlink.messages.base import Ack, decode

from .emulated_socket import EmulatedSocket
from .gateway import Gateway

ANSWER_SECONDS = 20.0


class _Memory(msgspec.Struct, array_like=True):
    newest: dict[str, int]
    """By stream: the stamp of its newest message that went to ROS."""

    counts: dict[str, int]
    link: dict[str, DirectionState]
    """By direction: how far the emulated link has come with its random numbers."""

    next_due: dict[str, int] = {}
    not_come: dict[str, int] = {}
    """See `MissingReadingCounter.memory`."""


def memory_of(gateway: Gateway, emulated: EmulatedSocket | None) -> bytes:
    """Return what a successor has to know."""
    link = {} if emulated is None else emulated.courses()
    missing_readings = gateway.missing_readings.memory()
    return msgspec.msgpack.encode(_Memory(gateway.newest, gateway.counts, link, *missing_readings))


def known_of(bus: Bus, run: str) -> bytes:
    """Return what physics knows of a predecessor; nothing where it knows of none."""
    for payload in bus.query(history_key(run), GATEWAY, seconds=ANSWER_SECONDS).values():
        return decode(payload, Ack).memory
    return b""


def recall(memory: bytes, gateway: Gateway, emulated: EmulatedSocket | None) -> None:
    """Go on from a predecessor's memory, in a life whose first clock was heard."""
    if not memory:
        return
    known = msgspec.msgpack.decode(memory, type=_Memory)
    gateway.newest = known.newest
    gateway.counts |= known.counts
    gateway.missing_readings.remember(known.next_due, known.not_come)
    if emulated is not None:
        emulated.take_up(known.link)
