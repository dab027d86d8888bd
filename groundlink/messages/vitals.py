# SPDX-License-Identifier: Apache-2.0
"""The message of the bus that tells what a vehicle's motors did and what it ran into.

Rule: sums since the run's start and events since the last message, as physics knows them; the same
rules as in `messages`. What wheels do on the ground is no event.
"""

from __future__ import annotations

from msgspec import Struct

from .base import BusMessage

VITALS_HZ = 10


class Contact(Struct, frozen=True):
    """A thing that a vehicle touched since the last message."""

    name: str
    """Of the solid of the world, or of the other vehicle."""

    force_n: float
    """The largest normal force of one contact point in one tick."""

    tick: int
    """When that was."""

    ticks: int
    """In how many ticks it was touched."""


class BatteryState(Struct, frozen=True):
    """What is in a vehicle's battery and what it gives."""

    charge: float
    """0..1, of its capacity."""

    voltage_v: float
    current_a: float


class Vitals(BusMessage, frozen=True):
    """Energy and contacts of one vehicle, 10 a second of sim time."""

    stamp_nanos: int
    vehicle: str
    tick: int
    motor_work_j: float
    """Mechanical work of the motors since the start, where they drive."""

    braked_j: float
    """Mechanical work that they took up since the start, where they brake; positive."""

    contacts: tuple[Contact, ...]
    """In the order of first touch."""

    battery: BatteryState | None = None
    """None: the vehicle's model has none."""
