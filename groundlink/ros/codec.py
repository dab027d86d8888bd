# SPDX-License-Identifier: Apache-2.0
"""Codec: how one message type of the bus and its ROS type become each other.

Each family of messages has a module with its codecs; `groundlink.ros.cdr` has the table of all.
The checks at the end are for messages of strangers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic

from groundlink.core.clock import NANOS
from groundlink.core.fields import Quaternion
from groundlink.messages.base import BadBusMessage, M

from .types import nanos

MAX_NAME_BYTES = 234
"""Longest name of a frame: what the header of a datagram holds."""


@dataclass(frozen=True)
class Moment:
    """Facts of a recorded message that its ROS type does not hold."""

    nanos: int
    """The run's time when it was recorded."""

    epoch_nanos: int


@dataclass(frozen=True)
class Codec(Generic[M]):
    """ROS type of one message type, with both directions."""

    message: type[M]
    ros_type: str
    encode: Callable[[M], dict[str, Any]]
    """Return the fields of the ROS message."""

    decode: Callable[[Any, Moment], M]
    """Exact inverse of `encode`: encoding the result gives the same bytes."""

    read: Callable[[Any, int], M] | None = None
    """Check a stranger's ROS message and return it, with the run's time for what has no stamp.

    Raises BadBusMessage. None where ROS never sends this message.
    """

    recorded_only: bool = False
    """The message is in recordings and never sent to ROS."""

    definition: str = ""
    """Definition of the ROS type (`.msg`), where it is no type of a ROS 2 distribution."""


def stamp_and_frame(ros: Any) -> tuple[int, str]:
    """Return the stamp and frame of a recorded message's header."""
    return nanos(ros.header.stamp), ros.header.frame_id


def checked_stamp_and_frame(header: Any) -> tuple[int, str]:
    """Return the stamp and frame of a stranger's std_msgs/Header."""
    return checked_nanos(header.stamp), checked_name(header.frame_id)


def checked_nanos(time: Any) -> int:
    """Return the nanoseconds of a stranger's builtin_interfaces/Time."""
    if time.nanosec >= NANOS:
        raise BadBusMessage(f"a time with {time.nanosec} ns")
    return nanos(time)


def checked_name(name: str) -> str:
    """Return the name of a stranger's frame or joint."""
    if len(name.encode()) > MAX_NAME_BYTES or "\0" in name:
        raise BadBusMessage("a frame's name that no frame has")
    return name


def check_finite(*numbers: float) -> None:
    """Raise BadBusMessage unless all numbers are finite."""
    if not all(map(math.isfinite, numbers)):
        raise BadBusMessage("a number is not finite")


def checked_unit(quaternion: Quaternion) -> Quaternion:
    """Return an orientation with unit length; ROS nodes write them with few digits."""
    length = math.hypot(*quaternion)
    if not 0.9 < length < 1.1:
        raise BadBusMessage(f"an orientation of length {length:.3g}; expected a unit quaternion")
    x, y, z, w = (component / length for component in quaternion)
    return x, y, z, w
