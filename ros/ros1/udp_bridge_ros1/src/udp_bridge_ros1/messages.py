# SPDX-License-Identifier: Apache-2.0
"""Message classes that rospy sends and hears without taking messages apart.

Rule: to ROS they are the type that they stand for: its name, its sum, its definition; within they
are bytes in ROS 1's form.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple, Sequence

import genpy

from udp_bridge.node.message_class import message_class

from .cdr import Buffer, ConversionPlan


class RawMessage(genpy.Message):  # type: ignore[misc]
    """A message as the bytes that it is; `RawType.raw` has it for one type."""

    __slots__ = ("chunks",)
    _slot_types = ()
    _has_header = False

    def __init__(self, *chunks: Buffer) -> None:
        self.chunks: Sequence[Buffer] = chunks

    def serialize(self, buff: Any) -> None:
        """Write it, as rospy asks."""
        buff.writelines(self.chunks)

    def deserialize(self, data: bytes) -> RawMessage:
        """Take what came, as rospy asks."""
        self.chunks = (data,)
        return self


class RawType(NamedTuple):
    """A message type, ready to be sent and heard."""

    raw: Any
    """A class derived from `RawMessage`."""
    plan: ConversionPlan


@lru_cache(maxsize=None)
def kind(ros_type: str) -> RawType:
    """Return what a type such as ``sensor_msgs/msg/Imu`` is in ROS 1.

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
