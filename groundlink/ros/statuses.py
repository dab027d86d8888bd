# SPDX-License-Identifier: Apache-2.0
"""A diagnostic_msgs/DiagnosticStatus: something's level and facts, the latter as pairs of text.

Rule: how one is made and read back, for all that is told in this form; what is told, and what its
words mean, is the others' business.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .types import TYPES

OK, WARN, ERROR = 0, 1, 2
"""diagnostic_msgs/DiagnosticStatus's constants."""


def status(
    name: str, level: int, message: str, facts: Mapping[str, object], *, hardware_id: str = ""
) -> Any:
    """Return a DiagnosticStatus; a fact that is None is an empty text."""
    pair = TYPES["diagnostic_msgs/msg/KeyValue"]
    values = [
        pair(key=key, value="" if value is None else str(value)) for key, value in facts.items()
    ]
    return TYPES["diagnostic_msgs/msg/DiagnosticStatus"](
        level=level, name=name, message=message, hardware_id=hardware_id, values=values
    )


def the_only(array: Any) -> tuple[str, dict[str, str]]:
    """Return the hardware and the facts of a DiagnosticArray's only status.

    Raises
    ------
    ValueError
        when it has none or several.
    """
    if len(array.status) != 1:
        raise ValueError(f"{len(array.status)} statuses, expected one")
    (told,) = array.status
    return told.hardware_id, {pair.key: pair.value for pair in told.values}
