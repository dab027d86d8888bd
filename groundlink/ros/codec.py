# SPDX-License-Identifier: Apache-2.0
"""Codec: conversion between a message type of the bus and its ROS type.

Each family of messages has a module with its codecs; `groundlink.ros.cdr` has the table of all. The
checks at the end are for messages from untrusted senders.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic

from groundlink.core.clock import NANOS
from groundlink.core.fields import Quaternion
from groundlink.messages.base import BadBusMessage, M

from .types import nanos

MAX_NAME_BYTES = 234
"""Length limit of frame names: the space in the header of a datagram."""


@dataclass(frozen=True)
class Moment:
    """Facts of a recorded message that its ROS type does not contain."""

    nanos: int
    """Run time of the recording."""

    epoch_nanos: int


@dataclass(frozen=True)
class Codec(Generic[M]):
    """ROS type of a message type, with both directions of the conversion."""

    message: type[M]
    ros_type: str
    encode: Callable[[M], dict[str, Any]]
    """Return the fields of the ROS message."""

    decode: Callable[[Any, Moment], M]
    """Exact inverse of `encode`: encoding the result gives the same bytes."""

    read: Callable[[Any, int], M] | None = None
    """Check a ROS message from an untrusted sender and return it as a bus message.

    Its second argument is the run's time, for messages without a stamp. Raises BadBusMessage. None
    if ROS never sends this message.
    """

    recorded_only: bool = False
    """Whether the message is in recordings only and never sent to ROS."""

    pack: Callable[[M], bytes] | None = None
    """Return the CDR of `encode`'s message, in a third of the time; for the most frequent ones."""

    definition: str = ""
    """Definition of the ROS type (`.msg`), if no ROS 2 distribution has it."""


def stamp_and_frame(ros: Any) -> tuple[int, str]:
    """Return the stamp and frame in the header of a recorded message."""
    return nanos(ros.header.stamp), ros.header.frame_id


def checked_stamp_and_frame(header: Any) -> tuple[int, str]:
    """Check a received std_msgs/Header and return its stamp and frame."""
    return checked_nanos(header.stamp), checked_name(header.frame_id)


def checked_nanos(time: Any) -> int:
    """Check a received builtin_interfaces/Time and return its nanoseconds."""
    if time.nanosec >= NANOS:
        raise BadBusMessage(f"a time with {time.nanosec} ns")
    return nanos(time)


def checked_name(name: str) -> str:
    """Check the received name of a frame or joint and return it."""
    if len(name.encode()) > MAX_NAME_BYTES or "\0" in name:
        raise BadBusMessage("a frame's name that no frame has")
    return name


def check_finite(*numbers: float) -> None:
    """Raise BadBusMessage unless all numbers are finite."""
    if not all(map(math.isfinite, numbers)):
        raise BadBusMessage("a number is not finite")


def checked_unit(quaternion: Quaternion) -> Quaternion:
    """Check a received orientation and normalize it; ROS nodes publish it with few digits."""
    length = math.hypot(*quaternion)
    if not 0.9 < length < 1.1:
        raise BadBusMessage(f"an orientation of length {length:.3g}; expected a unit quaternion")
    x, y, z, w = (component / length for component in quaternion)
    return x, y, z, w
