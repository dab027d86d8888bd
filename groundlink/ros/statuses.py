# SPDX-License-Identifier: Apache-2.0
"""Helpers for diagnostic_msgs/DiagnosticStatus: a level and key-value pairs of text."""

from collections.abc import Mapping
from typing import Any

from .types import TYPES

OK, WARN, ERROR = 0, 1, 2
"""Levels of diagnostic_msgs/DiagnosticStatus."""


def status(
    name: str, level: int, message: str, facts: Mapping[str, object], *, hardware_id: str = ""
) -> Any:
    """Return a DiagnosticStatus; the value of a fact that is None is an empty text."""
    pair = TYPES["diagnostic_msgs/msg/KeyValue"]
    values = [
        pair(key=key, value="" if value is None else str(value)) for key, value in facts.items()
    ]
    return TYPES["diagnostic_msgs/msg/DiagnosticStatus"](
        level=level, name=name, message=message, hardware_id=hardware_id, values=values
    )


def the_only(array: Any) -> tuple[str, dict[str, str]]:
    """Return the hardware name and the facts of a DiagnosticArray's only status.

    Raises
    ------
    ValueError
        when the array has no status or several.
    """
    if len(array.status) != 1:
        raise ValueError(f"{len(array.status)} statuses, expected one")
    (row,) = array.status
    return row.hardware_id, {pair.key: pair.value for pair in row.values}
