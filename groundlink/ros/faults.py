# SPDX-License-Identifier: Apache-2.0
"""Codec of a sensor's faults as diagnostic_msgs/DiagnosticArray.

The array has one status, with the level error if a fault is in effect. Each fault is a key-value
pair: its number, and its fields as JSON. Recordings can therefore be played without the package
groundlink_msgs.
"""

from typing import Any

import msgspec

from groundlink.episode.fault_messages import Faults
from groundlink.scenario.faults import Fault

from .codec import Codec, Moment
from .statuses import ERROR, OK, status, the_only
from .types import header, nanos

FAULT_PREFIX = "fault "
"""Prefix of the keys of faults; the fault's number follows."""


def faults(message: Faults) -> dict[str, Any]:
    """Return the fields of a DiagnosticArray."""
    facts = {"tick": str(message.tick)}
    for number, fault in enumerate(message.active, 1):
        facts[f"{FAULT_PREFIX}{number}"] = msgspec.json.encode(fault).decode()
    row = status(
        f"{message.sensor}: faults",
        ERROR if message.active else OK,
        ", ".join(fault.kind for fault in message.active) or "none",
        facts,
        hardware_id=message.sensor,
    )
    return {"header": header(message.stamp_nanos, ""), "status": [row]}


def from_faults(array: Any) -> Faults:
    """Return the faults in a DiagnosticArray that `faults` made.

    Raises
    ------
    ValueError
        when the array has another form.
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
