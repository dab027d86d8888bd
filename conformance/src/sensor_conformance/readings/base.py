# SPDX-License-Identifier: Apache-2.0
"""What all topics have: times of arrival, stamps, frames."""

from collections.abc import Iterable
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sensor_conformance.sources.source import Received, SourceTopic

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
T = TypeVar("T")

SAMPLES = 24
"""How many messages of a large type are kept whole, spread over the recording."""


def nanoseconds(stamp: Any) -> int:
    """Return a ROS time in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def vector(value: Any) -> tuple[float, float, float]:
    """Return x, y, z of a message."""
    return value.x, value.y, value.z


def quaternion(value: Any) -> tuple[float, float, float, float]:
    """Return x, y, z, w of a message."""
    return value.x, value.y, value.z, value.w


class Samples(Generic[T]):
    """Some items of a stream of unknown length, evenly spread: the first, then every 2^k-th."""

    def __init__(self, most: int = SAMPLES) -> None:
        self.items: list[tuple[int, T]] = []
        """Index in the stream, and item."""
        self._most = most
        self._step = 1

    def wants(self, index: int) -> bool:
        """Say whether the item of this index is to be kept."""
        return index % self._step == 0

    def keep(self, index: int, item: T) -> None:
        """Keep an item; drop every second one if there are too many."""
        self.items.append((index, item))
        if len(self.items) > self._most:
            self.items = self.items[::2]
            self._step *= 2


class TopicReadings:
    """Readings of a topic. A subclass takes what it needs out of each message.

    Parameters
    ----------
    topic
        Name and type.
    messages
        All messages in the order of their arrival.
    """

    types: ClassVar[tuple[str, ...]] = ()
    """ROS types that the class reads."""

    def __init__(self, topic: SourceTopic, messages: Iterable[Received]) -> None:
        self.name, self.type = topic
        self.frames: dict[str, None] = {}
        """All frames of the headers, in the order of their first appearance."""
        received: list[int] = []
        stamps: list[int] = []
        self.prepare()
        for index, (time, message) in enumerate(messages):
            received.append(time)
            if (header := getattr(message, "header", None)) is not None:
                stamps.append(nanoseconds(header.stamp))
                self.frames[str(header.frame_id)] = None
            self.take(index, message)
        self.received: Times = np.array(received, np.int64)
        self.stamps: Times = np.array(stamps, np.int64)
        """Nanoseconds; empty if the type has no header."""
        self.finish()

    def prepare(self) -> None:
        """Create the lists that `take` fills."""

    def take(self, index: int, message: Any) -> None:
        """Take what is needed out of a message."""

    def finish(self) -> None:
        """Turn the lists into arrays."""

    @property
    def frame(self) -> str:
        """The frame of the first message."""
        return next(iter(self.frames), "")

    @property
    def seconds(self) -> Floats:
        """Stamps in seconds since the first one."""
        return np.asarray((self.stamps - self.stamps[:1]) / 1e9, np.float64)

    @property
    def period(self) -> float:
        """Median interval of the stamps in seconds; NaN below two messages."""
        if len(self.stamps) < 2:
            return float("nan")
        return float(np.median(np.diff(self.stamps))) / 1e9
