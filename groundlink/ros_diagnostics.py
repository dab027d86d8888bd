# SPDX-License-Identifier: Apache-2.0
"""What the processes of a run say about themselves, as diagnostic_msgs/DiagnosticArray.

Rule: a status for each process and one for each stream that a gateway reports; every field is a
pair of text. Nothing is left out. The level is a warning where messages were lost.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec

from .messages import Health, StreamReport
from .ros_types import STORE, TYPES, header

DIAGNOSTICS_TOPIC = "/diagnostics"
DIAGNOSTICS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

_OK, _WARN = 0, 1
"""diagnostic_msgs/DiagnosticStatus's constants."""


def diagnostics(stamp_nanos: int, healths: Iterable[Health]) -> memoryview:
    """Return a DiagnosticArray in CDR of the latest word of every process."""
    statuses = []
    for health in healths:
        facts = msgspec.to_builtins(health)
        name, counters = facts.pop("process"), facts.pop("counters")
        facts.pop("streams")
        statuses.append(_status(name, _OK, "alive", facts | counters))
        statuses += [_of_stream(name, stream) for stream in health.streams]
    array = TYPES[DIAGNOSTICS_TYPE](header=header(stamp_nanos, ""), status=statuses)
    return STORE.serialize_cdr(array, DIAGNOSTICS_TYPE)


def _of_stream(process: str, stream: StreamReport) -> Any:
    facts = msgspec.to_builtins(stream)
    lost = stream.lost + stream.dropped
    message = f"{lost} of {stream.sent} lost" if lost else "all arrived"
    name = f"{process}: {facts['topic']} {facts['direction']}"
    return _status(name, _WARN if lost else _OK, message, facts)


def _status(name: str, level: int, message: str, facts: dict[str, Any]) -> Any:
    pair = TYPES["diagnostic_msgs/msg/KeyValue"]
    values = [
        pair(key=key, value="" if value is None else str(value)) for key, value in facts.items()
    ]
    return TYPES["diagnostic_msgs/msg/DiagnosticStatus"](
        level=level, name=name, message=message, hardware_id="", values=values
    )
