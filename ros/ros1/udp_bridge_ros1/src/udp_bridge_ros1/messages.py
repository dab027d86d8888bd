# SPDX-License-Identifier: Apache-2.0
"""Message classes for rospy that hold serialized bytes and decode nothing.

For ROS they are the type that they stand for: they have its name, checksum and definition.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple, Sequence

import genpy

from udp_bridge.node.message_class import message_class

from .cdr import Buffer, ConversionPlan


class RawMessage(genpy.Message):  # type: ignore[misc]
    """A message as serialized bytes; `RawType.raw` derives from it."""

    __slots__ = ("chunks",)
    _slot_types = ()
    _has_header = False

    def __init__(self, *chunks: Buffer) -> None:
        self.chunks: Sequence[Buffer] = chunks

    def serialize(self, buff: Any) -> None:
        """Write the bytes; called by rospy."""
        buff.writelines(self.chunks)

    def deserialize(self, data: bytes) -> RawMessage:
        """Keep received bytes; called by rospy."""
        self.chunks = (data,)
        return self


class RawType(NamedTuple):
    """A message type, ready to publish and subscribe."""

    raw: Any
    """A class derived from `RawMessage`."""
    plan: ConversionPlan


@lru_cache(maxsize=None)
def raw_type(ros_type: str) -> RawType:
    """Return the raw type of a ROS type such as ``sensor_msgs/msg/Imu``.

    Raises
    ------
    NotInstalled
        When its package is not installed.
    """
    known = message_class(ros_type)
    told = {part: getattr(known, part) for part in ("_type", "_md5sum", "_full_text")}
    return RawType(
        type(known.__name__, (RawMessage,), {"__slots__": (), **told}),
        ConversionPlan(known._full_text),
    )
