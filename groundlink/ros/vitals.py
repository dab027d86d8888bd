# SPDX-License-Identifier: Apache-2.0
"""Codec of a vehicle's vitals as diagnostic_msgs/DiagnosticArray.

The array has one status. Each figure is a key-value pair of text; the values of contacts and of the
battery are JSON. Recordings can therefore be played without the package groundlink_msgs.
"""

from typing import Any

import msgspec

from groundlink.messages.vitals import BatteryState, Contact, Vitals

from .codec import Codec, Moment
from .statuses import OK, WARN, status, the_only
from .types import header, nanos

CONTACT_PREFIX = "contact "
"""Prefix of the keys of contacts; the name of the touched object follows."""

_BATTERY = "battery"


def vitals(message: Vitals) -> dict[str, Any]:
    """Return the fields of a DiagnosticArray."""
    facts: dict[str, object] = {
        "tick": message.tick,
        "motor_work_j": message.motor_work_j,
        "braked_j": message.braked_j,
    }
    if message.battery:
        facts[_BATTERY] = msgspec.json.encode(message.battery).decode()
    for contact in message.contacts:
        rest = {"force_n": contact.force_n, "tick": contact.tick, "ticks": contact.ticks}
        facts[CONTACT_PREFIX + contact.name] = msgspec.json.encode(rest).decode()
    names = ", ".join(contact.name for contact in message.contacts)
    row = status(
        f"{message.vehicle}: vitals",
        WARN if names else OK,
        f"touches {names}" if names else "touches nothing",
        facts,
        hardware_id=message.vehicle,
    )
    return {"header": header(message.stamp_nanos, ""), "status": [row]}


def from_vitals(array: Any) -> Vitals:
    """Return the vitals in a DiagnosticArray that `vitals` made.

    Raises
    ------
    ValueError
        when the array has another form.
    """
    vehicle, facts = the_only(array)
    contacts = tuple(
        msgspec.convert(
            {"name": key.removeprefix(CONTACT_PREFIX)} | msgspec.json.decode(value), Contact
        )
        for key, value in facts.items()
        if key.startswith(CONTACT_PREFIX)
    )
    try:
        tick, work, braked = (facts[name] for name in ("tick", "motor_work_j", "braked_j"))
    except KeyError as error:
        raise ValueError(f"no {error} among its values") from None
    battery = msgspec.json.decode(facts[_BATTERY], type=BatteryState) if _BATTERY in facts else None
    return Vitals(
        nanos(array.header.stamp), vehicle, int(tick), float(work), float(braked), contacts, battery
    )


def _decode(ros: Any, moment: Moment) -> Vitals:
    return from_vitals(ros)


CODECS = (
    Codec(Vitals, "diagnostic_msgs/msg/DiagnosticArray", vitals, _decode, recorded_only=True),
)
