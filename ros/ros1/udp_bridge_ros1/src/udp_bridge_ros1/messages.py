# SPDX-License-Identifier: Apache-2.0
"""Message classes for rospy that hold serialized bytes and decode nothing.

To ROS, such a class is the type that it represents: it has the same name, checksum and definition.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple, Sequence

import genpy

from udp_bridge.node.message_class import message_class

from .cdr import Buffer, ConversionPlan


class RawMessage(genpy.Message):  # type: ignore[misc]
    """Message as serialized bytes; base class of `RawType.raw`."""

    __slots__ = ("chunks",)
    _slot_types = ()
    _has_header = False

    def __init__(self, *chunks: Buffer) -> None:
        self.chunks: Sequence[Buffer] = chunks

    def serialize(self, buff: Any) -> None:
        """Write the bytes; called by rospy."""
        buff.writelines(self.chunks)

    def deserialize(self, data: bytes) -> RawMessage:
        """Keep the received bytes; called by rospy."""
        self.chunks = (data,)
        return self


class RawType(NamedTuple):
    """Message type that can be published and subscribed to."""

    raw: Any
    """Class derived from `RawMessage`."""
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
