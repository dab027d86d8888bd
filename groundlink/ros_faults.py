# SPDX-License-Identifier: Apache-2.0
"""A sensor's faults as a ROS message of its standard types: diagnostic_msgs/DiagnosticArray.

Rule: one status, an error where a fault is in effect; each fault is a pair of text, its number and
what a scenario says of it as JSON. So a recording plays where no message package of ours is built.
"""

from __future__ import annotations

from typing import Any

import msgspec

from .faults import Faults
from .ros_types import TYPES, header
from .scenario.faults import Fault

FAULT_PREFIX = "fault "
"""Before a fault's number in a pair's key."""

_OK, _ERROR = 0, 2
"""diagnostic_msgs/DiagnosticStatus's constants."""


def faults(message: Faults) -> dict[str, Any]:
    """Return the fields of a DiagnosticArray."""
    facts = {"tick": str(message.tick)}
    for number, fault in enumerate(message.active, 1):
        facts[f"{FAULT_PREFIX}{number}"] = msgspec.json.encode(fault).decode()
    pair = TYPES["diagnostic_msgs/msg/KeyValue"]
    status = TYPES["diagnostic_msgs/msg/DiagnosticStatus"](
        level=_ERROR if message.active else _OK,
        name=f"{message.sensor}: faults",
        message=", ".join(fault.kind for fault in message.active) or "none",
        hardware_id=message.sensor,
        values=[pair(key=key, value=value) for key, value in facts.items()],
    )
    return {"header": header(message.stamp_nanos, ""), "status": [status]}


def from_faults(array: Any, stamp_nanos: int) -> Faults:
    """Return the faults that a DiagnosticArray was filled with.

    Raises
    ------
    ValueError
        when it was not.
    """
    if len(array.status) != 1:
        raise ValueError(f"{len(array.status)} statuses, expected one")
    status = array.status[0]
    facts = {pair.key: pair.value for pair in status.values}
    if "tick" not in facts:
        raise ValueError("no `tick` among its values")
    active = tuple(
        msgspec.json.decode(value, type=Fault)
        for key, value in facts.items()
        if key.startswith(FAULT_PREFIX)
    )
    return Faults(stamp_nanos, status.hardware_id, int(facts["tick"]), active)
