# SPDX-License-Identifier: Apache-2.0
"""What a sensor's process tells of its faults: on the bus when they begin or end, and when asked.

Rule: a message holds all that are in effect from its stamp on, until the next one; so the begin and
the end of each are the stamps of two messages. The same rules as in `messages`.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from groundlink.messages.base import BusMessage
from groundlink.scenario.faults import Fault

COUNTER_PREFIX = "fault_"
"""Of the counters of a sensor that say how many faults of a kind are in effect."""

CLEAR = "clear"
"""Request that ends all active faults. An empty request is a query; any other is a fault."""


class Faults(BusMessage, frozen=True):
    """The faults of one sensor, told when one begins or ends."""

    stamp_nanos: int
    """The instant of `tick`."""

    sensor: str
    """vehicle/sensor."""

    tick: int
    """The first at which it is so."""

    active: tuple[Fault, ...]
    """Those in effect, with what the scenario or a command says of them."""


class FaultAnswer(Struct, frozen=True):
    """Reply of a sensor's process to a request."""

    error: str = ""
    """Why it was not done; empty when it was."""

    tick: int = -1
    """From which on the rest holds: the next one."""

    active: tuple[Fault, ...] = ()
    """What is in effect then."""


def counted(active: tuple[Fault, ...]) -> dict[str, int]:
    """Return the counters by which a process's health tells its faults."""
    kinds = [COUNTER_PREFIX + fault.kind for fault in active]
    return {kind: kinds.count(kind) for kind in kinds}


def kinds_in(counters: Mapping[str, int]) -> list[str]:
    """Return the kinds of fault that a process's counters tell of."""
    return [
        name.removeprefix(COUNTER_PREFIX) for name in counters if name.startswith(COUNTER_PREFIX)
    ]
