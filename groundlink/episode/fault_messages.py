# SPDX-License-Identifier: Apache-2.0
"""Fault messages of a sensor: reports on the bus, and replies to requests.

A report holds all faults that are in effect from its stamp until the next report. The begin and the
end of a fault are therefore the stamps of two reports.
"""

from collections.abc import Mapping

from msgspec import Struct

from groundlink.messages.base import BusMessage
from groundlink.scenario.faults import Fault

COUNTER_PREFIX = "fault_"
"""Prefix of a sensor's health counters for active faults; the kind of fault follows."""

CLEAR = "clear"
"""Request that ends all active faults. An empty request is a query; any other request is a fault.
"""


class Faults(BusMessage, frozen=True):
    """Active faults of a sensor, published when a fault begins or ends."""

    stamp_nanos: int
    """Instant of `tick`."""

    sensor: str
    """Name as vehicle/sensor."""

    tick: int
    """First tick at which these faults are in effect."""

    active: tuple[Fault, ...]
    """Active faults, with their fields in the scenario or the command."""


class FaultAnswer(Struct, frozen=True):
    """Reply of a sensor's process to a request."""

    error: str = ""
    """Reason of a rejected request; empty if it was executed."""

    tick: int = -1
    """Tick from which `active` applies: the next tick."""

    active: tuple[Fault, ...] = ()
    """Active faults at that tick."""


def counted(active: tuple[Fault, ...]) -> dict[str, int]:
    """Return active faults as health counters."""
    kinds = [COUNTER_PREFIX + fault.kind for fault in active]
    return {kind: kinds.count(kind) for kind in kinds}


def kinds_in(counters: Mapping[str, int]) -> list[str]:
    """Return the kinds of the active faults in health counters."""
    return [
        name.removeprefix(COUNTER_PREFIX) for name in counters if name.startswith(COUNTER_PREFIX)
    ]
