# SPDX-License-Identifier: Apache-2.0
"""What a sensor is missing as a ROS message of its standard types: diagnostic_msgs/DiagnosticArray.

Rule: one status, a warning; each gap is a pair of text, its number and itself as JSON. So a
recording plays where no message package of ours is built.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import msgspec

from groundlink.messages.missing_readings import MissingReadings, MissingSpan, in_words

from .codec import Codec, Moment
from .statuses import WARN, status, the_only
from .types import header, nanos


def _encode(message: MissingReadings) -> dict[str, Any]:
    """Return the fields of a DiagnosticArray."""
    missing: Counter[str] = Counter()
    for gap in message.gaps:
        missing[gap.cause] += gap.readings
    facts = {
        f"gap {number}": msgspec.json.encode(gap).decode()
        for number, gap in enumerate(message.gaps, 1)
    }
    told = status(
        f"{message.sensor}: gaps", WARN, in_words(missing), facts, hardware_id=message.sensor
    )
    return {"header": header(message.stamp_nanos, ""), "status": [told]}


def from_missing_readings(array: Any) -> MissingReadings:
    """Return the gaps that a DiagnosticArray was filled with.

    Raises
    ------
    ValueError
        when it was not.
    """
    sensor, facts = the_only(array)
    found = tuple(msgspec.json.decode(value, type=MissingSpan) for value in facts.values())
    return MissingReadings(nanos(array.header.stamp), sensor, found)


def _decode(ros: Any, moment: Moment) -> MissingReadings:
    return from_missing_readings(ros)


CODECS = (
    Codec(
        MissingReadings, "diagnostic_msgs/msg/DiagnosticArray", _encode, _decode, recorded_only=True
    ),
)
