# SPDX-License-Identifier: Apache-2.0
"""Table of all codecs, and conversion between bus messages and CDR bytes.

The gateway, recorder, replay and viewer share this table. It includes the messages that installed
sensor kinds define.
"""

import struct
from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from groundlink.bus.shared_slots import RoomAround, room_around
from groundlink.messages.base import BadBusMessage, BusMessage, M, Relayed
from groundlink.scenario.joints import JointInterface
from groundlink.scenario.sensor_kinds import load_reference, sensor_kinds

from . import diagnostics, imagery, motion, navigation, points
from .codec import Codec, Moment
from .joint_commands import MULTI_ARRAY, read_joint_group, read_joint_state
from .types import STORE, TYPES, register_unknown

Body = bytes | bytearray | memoryview

Reader = Callable[[Body, int], BusMessage]
"""Converts a body and the run's time to a message of the bus. Raises BadBusMessage."""

_NO_DATA = np.zeros(0, np.uint8)

_FAMILIES = (motion, points, imagery, navigation, diagnostics)


def _of_kinds() -> list[Codec[Any]]:
    """Return the codecs of the messages that sensor kinds define."""
    support = chain.from_iterable(kind.messages.values() for kind in sensor_kinds().values())
    return [load_reference(own.codec) for own in support]


CODECS: dict[type[BusMessage], Codec[Any]] = {
    codec.message: codec
    for codec in (*chain.from_iterable(family.CODECS for family in _FAMILIES), *_of_kinds())
}
"""All codecs by message type."""

register_unknown({codec.ros_type: codec.definition for codec in CODECS.values()})

ROS_CODECS = {message: codec for message, codec in CODECS.items() if not codec.recorded_only}
"""Codecs of the messages that go to ROS."""


def ros_type_of(message: type[BusMessage], relayed_type: str = "") -> str:
    """Return the ROS type of a stream; `relayed_type` is that of relayed messages."""
    return relayed_type if message is Relayed else CODECS[message].ros_type


def to_cdr(message: BusMessage) -> memoryview:
    """Return a message as CDR of its ROS type, with the encapsulation header.

    Raises
    ------
    BadBusMessage
        when a number is out of range for the ROS type: a stamp after 2038, a large float32.
    """
    if isinstance(message, Relayed):
        return message.cdr
    codec = CODECS[type(message)]
    try:
        if codec.pack is not None:
            return memoryview(codec.pack(message))
        fields = codec.encode(message)
        if codec.ros_type in _BYTES_BEHIND_DATA and (room := room_around(fields["data"])):
            return _around_data(codec.ros_type, fields, room)
        return STORE.serialize_cdr(TYPES[codec.ros_type](**fields), codec.ros_type)
    except (struct.error, SerdeError, OverflowError) as error:
        raise BadBusMessage(
            f"no {codec.ros_type} holds this {type(message).__name__}: {error}"
        ) from None


_BYTES_BEHIND_DATA = {
    "sensor_msgs/msg/Image": 0,
    "sensor_msgs/msg/CompressedImage": 0,
    "sensor_msgs/msg/PointCloud2": 1,
}
"""Types that end with `uint8[] data`, or with a bool behind it: how many bytes follow."""

_LENGTH = struct.Struct("<I")


def _around_data(ros_type: str, fields: dict[str, Any], room: RoomAround) -> memoryview:
    """Return CDR that is written around the data, where the message of the bus was."""
    size = len(fields["data"])
    around = STORE.serialize_cdr(TYPES[ros_type](**fields | {"data": _NO_DATA}), ros_type)
    end_of_head = len(around) - _BYTES_BEHIND_DATA[ros_type]
    head = bytes(around[: end_of_head - _LENGTH.size]) + _LENGTH.pack(size)
    return room.enclose(head, bytes(around[end_of_head:]))


def from_cdr(cdr: bytes | memoryview, message_type: type[M], moment: Moment) -> M:
    """Return the bus message that was encoded to this CDR. Use `READERS` for untrusted CDR.

    Raises
    ------
    BadBusMessage
        when the bytes are not a valid message of this type.
    """
    codec = CODECS[message_type]
    try:
        found: M = codec.decode(STORE.deserialize_cdr(cdr, codec.ros_type), moment)
    except (SerdeError, ValueError, KeyError) as error:
        raise BadBusMessage(
            f"no {message_type.__name__} in this {codec.ros_type}: {error}"
        ) from None
    return found


def _decoded(body: Body, ros_type: str) -> Any:
    try:
        return STORE.deserialize_cdr(bytes(body), ros_type)
    except SerdeError as error:
        raise BadBusMessage(f"not a {ros_type}: {error}") from None


def _read(body: Body, now_nanos: int, *, ros_type: str, checked: Callable[[Any, int], M]) -> M:
    return checked(_decoded(body, ros_type), now_nanos)


READERS: dict[str, Reader] = {
    ros_type: partial(_read, ros_type=ros_type, checked=checked)
    for ros_type, checked in (
        *((codec.ros_type, codec.read) for codec in CODECS.values() if codec.read is not None),
        ("geometry_msgs/msg/TwistStamped", motion.read_twist_stamped),
    )
}
"""Readers of untrusted bodies by ROS type. Stamps are kept; numbers, sizes and names are checked.
"""


def reader(
    message: type[BusMessage], ros_type: str, joints: Sequence[JointInterface] = ()
) -> Reader:
    """Return a function that reads bodies of a ROS type as bus messages of one type.

    Parameters
    ----------
    joints
        joints that a command's values belong to; see `RosStream.joints`.
    """
    if joints:
        checked = read_joint_group if ros_type == MULTI_ARRAY else read_joint_state
        return partial(_read, ros_type=ros_type, checked=partial(checked, joints=joints))
    return partial(relayed, ros_type=ros_type) if message is Relayed else READERS[ros_type]


def relayed(body: Body, now_nanos: int, *, ros_type: str) -> Relayed:
    """Return a body unchanged if it is a valid message of its type."""
    _decoded(body, ros_type)
    return Relayed(now_nanos, ros_type, memoryview(bytes(body)))
