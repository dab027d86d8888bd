# SPDX-License-Identifier: Apache-2.0
"""Health of the processes of a run as diagnostic_msgs/DiagnosticArray.

The array has a status for each process and for each stream that a gateway reports; every field is a
key-value pair of text. The level is a warning if messages were lost or readings are missing.
"""

from collections.abc import Iterable
from typing import Any

import msgspec

from groundlink.messages.base import NOT_REPORTED, Health, StreamReport
from groundlink.messages.missing_readings import in_words, parted

from .statuses import OK, WARN, status
from .types import STORE, TYPES, header

DIAGNOSTICS_TOPIC = "/diagnostics"
DIAGNOSTICS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"


def diagnostics(stamp_nanos: int, healths: Iterable[Health]) -> memoryview:
    """Return a DiagnosticArray in CDR with the newest health report of every process."""
    statuses = []
    for health in healths:
        facts = msgspec.to_builtins(health)
        name, counters = facts.pop("process"), facts.pop("counters")
        facts.pop("streams")
        missing, _ = parted(counters)
        level, word = (WARN, f"missing {in_words(missing)}") if missing else (OK, "alive")
        statuses.append(status(name, level, word, facts | counters))
        statuses += [_of_stream(name, stream) for stream in health.streams]
    array = TYPES[DIAGNOSTICS_TYPE](header=header(stamp_nanos, ""), status=statuses)
    return STORE.serialize_cdr(array, DIAGNOSTICS_TYPE)


def _of_stream(process: str, stream: StreamReport) -> Any:
    facts = msgspec.to_builtins(stream)
    lost = stream.lost + stream.dropped
    message = f"{lost} of {stream.sent} lost" if lost else "all arrived"
    if not stream.reported:
        message = NOT_REPORTED
    name = f"{process}: {facts['topic']} {facts['direction']}"
    return status(name, WARN if lost else OK, message, facts)
