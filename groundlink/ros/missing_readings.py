# SPDX-License-Identifier: Apache-2.0
"""Codec of a sensor's missing readings as diagnostic_msgs/DiagnosticArray.

The array has one status with the level warning. Each gap is a key-value pair: its number, and its
fields as JSON. Recordings can therefore be played without the package groundlink_msgs.
"""

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
    row = status(
        f"{message.sensor}: gaps", WARN, in_words(missing), facts, hardware_id=message.sensor
    )
    return {"header": header(message.stamp_nanos, ""), "status": [row]}


def from_missing_readings(array: Any) -> MissingReadings:
    """Return the missing readings in a DiagnosticArray of this codec.

    Raises
    ------
    ValueError
        when the array has another form.
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
