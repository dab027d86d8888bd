# SPDX-License-Identifier: Apache-2.0
"""A full message definition, as ROS 1 carries it in `_full_text` and in bags, taken apart.

Rule: it knows text alone: fields and the types that they are made of, no bytes.
"""

from __future__ import annotations

import re
from typing import Dict, List, NamedTuple, Optional

HEADER = "std_msgs/Header"
_FIELD = re.compile(r"([A-Za-z][\w/]*)(?:\[(\d*)\])?\s+([A-Za-z]\w*)")
_BETWEEN = re.compile(r"^=+\nMSG: *(\S+)\n", re.MULTILINE)


class Field(NamedTuple):
    """One field of a message."""

    type_name: str
    """A primitive of ROS, or the name that `Definition.parts` has the fields of."""
    length: Optional[int]
    """Of a fixed array; -1 of one that says its length itself; None of no array."""


class Definition(NamedTuple):
    """Fields of a message, and of all messages that it is made of."""

    fields: List[Field]
    parts: Dict[str, List[Field]]


def parse(full_text: str) -> Definition:
    """Return what a definition says.

    Parameters
    ----------
    full_text
        The fields of the type itself, then those of each type it is made of, each under a line of
        `=` and one `MSG: package/Name`.

    Raises
    ------
    ValueError
        When a line is no field and no constant, or a part is missing.
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
        if not said or "=" in said:  # a constant takes no room in a message
            continue
        match = _FIELD.fullmatch(said)
        if match is None:
            raise ValueError(f"{line!r} is no field of a message")
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
