# SPDX-License-Identifier: Apache-2.0
"""Body of a Typed message (type 67), to the byte: the name of any ROS type, then its CDR.

Typed carries messages whose ROS type has no number of its own. The body is opaque here.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import NamedTuple

from .header import BadMessage, Buffer, Refused

TYPE_NAME_MAX = 255
"""Bytes of a type's name at most."""
_UNIT = 8
"""The CDR begins at a multiple of this, so that its numbers are aligned as in numbered types."""
_NAME = re.compile(rb"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")


class Typed(NamedTuple):
    """A ROS type, and where the CDR of a message of that type begins in its body."""

    ros_type: str
    """Full ROS 2 type name, such as ``sensor_msgs/msg/MagneticField``."""
    offset: int
    """Bytes before the CDR: a multiple of 8."""


def pack_typed(ros_type: str, cdr: Buffer) -> bytes:
    """Return the body of a Typed message.

    Parameters
    ----------
    ros_type
        Full ROS 2 type name, such as ``sensor_msgs/msg/MagneticField``.
    cdr
        The complete message in CDR, with its 4-byte encapsulation header.

    Raises
    ------
    BadMessage
        When `ros_type` is not a full type name of at most 255 bytes.
    """
    return b"".join((typed_prefix(ros_type), cdr))


@lru_cache(maxsize=256)
def typed_prefix(ros_type: str) -> bytes:
    """Return the bytes before the CDR: the size of the name, the name and its padding.

    Raises
    ------
    BadMessage
        When `ros_type` is not a full type name of at most 255 bytes.
    """
    name = ros_type.encode()
    if len(name) > TYPE_NAME_MAX or not _NAME.fullmatch(name):
        raise BadMessage(
            f"ROS type {ros_type[:80]!r}: expected package/msg/Name of at most"
            f" {TYPE_NAME_MAX} bytes, such as sensor_msgs/msg/MagneticField"
        )
    size = 1 + len(name)
    return bytes([len(name)]) + name + bytes(-size % _UNIT)


def parse_typed(body: Buffer) -> Typed:
    """Return the type that a Typed body names, and the offset of its CDR.

    Raises
    ------
    Refused
        `type_name` when the body does not begin with a valid type name and its padding.
    """
    if not len(body):
        raise Refused("type_name")
    size = body[0] + 1
    offset = size + -size % _UNIT
    if offset > len(body):
        raise Refused("type_name")
    return _parsed(bytes(body[1:size]), offset)


@lru_cache(maxsize=256)
def _parsed(name: bytes, offset: int) -> Typed:
    if not _NAME.fullmatch(name):
        raise Refused("type_name")
    return Typed(name.decode(), offset)
