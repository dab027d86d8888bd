# SPDX-License-Identifier: Apache-2.0
"""Playback: messages of a recording as messages of the bus, with their due times.

A reading is due when its measurement ended: a cloud at the end of its revolution or block, all
other messages at their stamp. A clock precedes messages due at the same time; no message precedes
the first clock.
"""

import heapq
import itertools
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from msgspec.structs import replace

from groundlink.core.clock import NANOS
from groundlink.messages.base import BadBusMessage, BusMessage, Clock, PointCloud, Reading, Relayed
from groundlink.ros.cdr import from_cdr
from groundlink.ros.codec import Moment
from groundlink.ros.streams import Outgoing, RosStream

from .reader import RecordedMessage, Recording


class TimedMessage(NamedTuple):
    """A message of the bus with its due time."""

    nanos: int
    """The run's time."""

    rank: int
    """Order among messages due at the same time."""

    number: int
    key: str
    message: BusMessage


class Playback:
    """Playback of some streams of a recording.

    Parameters
    ----------
    streams
        streams of the run; those not recorded are left out.
    added
        stream of each topic whose messages are added.
    """

    def __init__(
        self, recording: Recording, streams: Iterable[RosStream], added: Iterable[RosStream] = ()
    ) -> None:
        self._recording = recording
        self.streams: dict[str, RosStream] = {
            stream.topic: stream for stream in streams if stream.topic in recording.types
        }
        """By topic."""

        self._added = {stream.topic: stream for stream in added}

        self.refused = 0
        """Messages that do not match the type of their topic."""

    def play(
        self, from_nanos: int, added: Iterable[RecordedMessage] = ()
    ) -> Iterator[TimedMessage]:
        """Yield messages due from an instant on, and those added, in order."""
        recorded = self._recording.read(list(self.streams), from_nanos=from_nanos)
        merged = heapq.merge(recorded, added, key=lambda message: message.nanos)
        return itertools.dropwhile(
            lambda due: not isinstance(due.message, Clock), self._sorted(merged)
        )

    def _sorted(self, messages: Iterable[RecordedMessage]) -> Iterator[TimedMessage]:
        streams = self.streams | self._added
        waiting: list[TimedMessage] = []
        numbers = itertools.count()
        for recorded in messages:
            while waiting and waiting[0].nanos < recorded.nanos:
                yield heapq.heappop(waiting)
            if (stream := streams.get(recorded.topic)) is None:
                continue
            try:
                message = self._message(stream, recorded)
            except BadBusMessage:
                self.refused += 1
                continue
            if isinstance(message, Reading):
                error = message.stamp_nanos - recorded.nanos  # type: ignore[attr-defined]
                message = replace(message, clock_error_nanos=error)
            rank = 0 if stream.message is Clock else 1
            due_nanos = recorded.nanos + _takes_nanos(stream)
            heapq.heappush(
                waiting, TimedMessage(due_nanos, rank, next(numbers), stream.key, message)
            )
        while waiting:
            yield heapq.heappop(waiting)

    def _message(self, stream: RosStream, recorded: RecordedMessage) -> BusMessage:
        if stream.message is Relayed:
            return Relayed(recorded.nanos, recorded.ros_type, memoryview(recorded.cdr))
        moment = Moment(recorded.nanos, self._recording.run.epoch_nanos)
        return from_cdr(recorded.cdr, stream.message, moment)


def _takes_nanos(stream: RosStream) -> int:
    """Return the duration of a measurement after its stamp."""
    if stream.message is PointCloud and isinstance(stream, Outgoing):
        return round(NANOS / stream.declared_hz)
    return 0
