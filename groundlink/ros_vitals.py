# SPDX-License-Identifier: Apache-2.0
"""A vehicle's vitals as a ROS message of its standard types: diagnostic_msgs/DiagnosticArray.

Rule: one status; every figure is a pair of text, a contact or the battery is one too, with JSON as
its value. So a recording plays where no message package of ours is built.
"""

from __future__ import annotations

from typing import Any

import msgspec

from .ros_types import TYPES, header
from .vitals import BatteryState, Contact, Vitals

CONTACT_PREFIX = "contact "
"""Before the touched thing's name in a pair's key."""

_BATTERY = "battery"
_OK, _WARN = 0, 1
"""diagnostic_msgs/DiagnosticStatus's constants."""


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
    pair = TYPES["diagnostic_msgs/msg/KeyValue"]
    status = TYPES["diagnostic_msgs/msg/DiagnosticStatus"](
        level=_WARN if names else _OK,
        name=f"{message.vehicle}: vitals",
        message=f"touches {names}" if names else "touches nothing",
        hardware_id=message.vehicle,
        values=[pair(key=key, value=str(value)) for key, value in facts.items()],
    )
    return {"header": header(message.stamp_nanos, ""), "status": [status]}


def from_vitals(array: Any, stamp_nanos: int) -> Vitals:
    """Return the vitals that a DiagnosticArray was filled with.

    Raises
    ------
    ValueError
        when it was not.
    """
    if len(array.status) != 1:
        raise ValueError(f"{len(array.status)} statuses, expected one")
    status = array.status[0]
    facts = {pair.key: pair.value for pair in status.values}
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
        stamp_nanos, status.hardware_id, int(tick), float(work), float(braked), contacts, battery
    )
