# SPDX-License-Identifier: Apache-2.0
"""A sensor's faults as a ROS message of its standard types: diagnostic_msgs/DiagnosticArray.

Rule: one status, an error where a fault is in effect; each fault is a pair of text, its number and
what a scenario says of it as JSON. So a recording plays where no message package of ours is built.
"""

from __future__ import annotations

from typing import Any

import msgspec

from groundlink.run.fault_messages import Faults
from groundlink.scenario.faults import Fault

from .codec import Codec, Moment
from .statuses import ERROR, OK, status, the_only
from .types import header, nanos

FAULT_PREFIX = "fault "
"""Before a fault's number in a pair's key."""


def faults(message: Faults) -> dict[str, Any]:
    """Return the fields of a DiagnosticArray."""
    facts = {"tick": str(message.tick)}
    for number, fault in enumerate(message.active, 1):
        facts[f"{FAULT_PREFIX}{number}"] = msgspec.json.encode(fault).decode()
    told = status(
        f"{message.sensor}: faults",
        ERROR if message.active else OK,
        ", ".join(fault.kind for fault in message.active) or "none",
        facts,
        hardware_id=message.sensor,
    )
    return {"header": header(message.stamp_nanos, ""), "status": [told]}


def from_faults(array: Any) -> Faults:
    """Return the faults that a DiagnosticArray was filled with.

    Raises
    ------
    ValueError
        when it was not.
    """
    sensor, facts = the_only(array)
    if "tick" not in facts:
        raise ValueError("no `tick` among its values")
    active = tuple(
        msgspec.json.decode(value, type=Fault)
        for key, value in facts.items()
        if key.startswith(FAULT_PREFIX)
    )
    return Faults(nanos(array.header.stamp), sensor, int(facts["tick"]), active)


def _decode(ros: Any, moment: Moment) -> Faults:
    return from_faults(ros)


CODECS = (
    Codec(Faults, "diagnostic_msgs/msg/DiagnosticArray", faults, _decode, recorded_only=True),
)
