# SPDX-License-Identifier: Apache-2.0
"""The interface of all sources: topics, and the messages of a topic."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol


class SourceTopic(NamedTuple):
    """A topic of a recording."""

    name: str
    type: str
    """Name of the ROS type with three parts, such as ``sensor_msgs/msg/Imu``, for ROS 1 as well."""


class Received(NamedTuple):
    """A message and the time of its arrival."""

    time: int
    """Nanoseconds by the clock of the recorder."""
    message: Any
    """Any object with the fields of the ROS message as attributes."""


class MessageSource(Protocol):
    """A recording, or anything that can be read like one."""

    name: str

    def topics(self) -> Sequence[SourceTopic]:
        """Return all topics."""
        ...

    def messages(self, topic: str) -> Iterator[Received]:
        """Yield the messages of a topic in the order of their arrival."""
        ...


class UnreadableSource(Exception):
    """A recording can't be read; the text says why, in one line."""
