# SPDX-License-Identifier: Apache-2.0
"""Parser of a full ROS 1 message definition, as found in `_full_text` and in bags.

The parser handles text only: fields and their types, not serialized bytes.
"""

from __future__ import annotations

import re
from typing import Dict, List, NamedTuple, Optional

HEADER = "std_msgs/Header"
_FIELD = re.compile(r"([A-Za-z][\w/]*)(?:\[(\d*)\])?\s+([A-Za-z]\w*)")
_BETWEEN = re.compile(r"^=+\nMSG: *(\S+)\n", re.MULTILINE)


class Field(NamedTuple):
    """Field of a message."""

    type_name: str
    """ROS primitive, or a key of `Definition.parts`."""
    length: Optional[int]
    """Length of a fixed array; -1 for a variable-length array; None for no array."""


class Definition(NamedTuple):
    """Fields of a message, and of all message types that it contains."""

    fields: List[Field]
    parts: Dict[str, List[Field]]


def parse(full_text: str) -> Definition:
    """Parse a full definition.

    Parameters
    ----------
    full_text
        The fields of the type itself, then those of each contained type, each after a line of `=`
        and a line `MSG: package/Name`.

    Raises
    ------
    ValueError
        When a line is neither a field nor a constant, or a contained type is missing.
    """
    own, *rest = _BETWEEN.split(full_text)
    texts = dict(zip(rest[::2], rest[1::2]))
    return Definition(
        _fields(own, texts), {name: _fields(text, texts) for name, text in texts.items()}
    )


def _fields(text: str, texts: Dict[str, str]) -> List[Field]:
    fields = []
    for line in text.splitlines():
        said = line.partition("#")[0].strip()
        if not said or "=" in said:  # constants are not serialized
            continue
        match = _FIELD.fullmatch(said)
        if match is None:
            raise ValueError(f"{line!r} is not a field of a message")
        type_name, count, _ = match.groups()
        fields.append(
            Field(
                _full_name(type_name, texts), None if count is None else int(count) if count else -1
            )
        )
    return fields


def _full_name(name: str, texts: Dict[str, str]) -> str:
    if name in texts:
        return name
    return next((full for full in texts if full.rpartition("/")[2] == name), name)
