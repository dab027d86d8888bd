# SPDX-License-Identifier: Apache-2.0
"""Vitals of a vehicle: motor energy, contacts and battery.

Energies are sums since the start of the run; contacts are those since the last message. Contact of
wheels with the ground is not included.
"""

from msgspec import Struct

from .base import BusMessage

VITALS_HZ = 10


class Contact(Struct, frozen=True):
    """An object that a vehicle touched since the last message."""

    name: str
    """Name of the solid, or of the other vehicle."""

    force_n: float
    """Largest normal force of a contact point in one tick."""

    tick: int
    """Tick of the largest force."""

    ticks: int
    """Number of ticks with contact."""


class BatteryState(Struct, frozen=True):
    """Charge, voltage and current of a vehicle's battery."""

    charge: float
    """State of charge, 0..1."""

    voltage_v: float
    current_a: float


class Vitals(BusMessage, frozen=True):
    """Energy and contacts of a vehicle, 10 times per second of sim time."""

    stamp_nanos: int
    vehicle: str
    tick: int
    motor_work_j: float
    """Mechanical work of the motors in drive since the start."""

    braked_j: float
    """Mechanical work that the motors absorbed in braking since the start; positive."""

    contacts: tuple[Contact, ...]
    """Contacts in the order of the first touch."""

    battery: BatteryState | None = None
    """Battery; none if the vehicle's model has no battery."""
