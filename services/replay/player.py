# SPDX-License-Identifier: Apache-2.0
"""A recorded run as messages of the bus, each with the instant at which it is due.

Rule: a recording in, messages out; nobody waits here. A reading is due when it had been measured:
a cloud at the end of its revolution or block, all else at its stamp. A clock goes before what is
due with it, and nothing before the first clock.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from typing import NamedTuple

from msgspec.structs import replace

from groundlink.clock import NANOS
from groundlink.messages import BadMessage, Clock, Command, Message, PointCloud, Reading
from groundlink.recording.reading import Recording
from groundlink.ros_readings import Moment, from_cdr
from groundlink.ros_streams import Outgoing, RosStream, incoming, outgoing, recorded_only


class Due(NamedTuple):
    """A message of the bus and when it goes out."""

    nanos: int
    """The run's time."""

    rank: int
    """Among what is due at once: lower goes first."""

    number: int
    key: str
    message: Message


class Player:
    """The streams of a recording that physics and sensors once published, and the commands.

    What the vehicle's stack told of itself is left out: the stack that is tested tells it anew.

    Parameters
    ----------
    run
        name under which the run is on the bus.
    """

    def __init__(self, recording: Recording, run: str) -> None:
        self._recording = recording
        scenario = recording.run.scenario
        commands = [stream for stream in incoming(scenario, run) if stream.message is Command]
        self.streams: dict[str, RosStream] = {
            stream.topic: stream
            for stream in (*commands, *outgoing(scenario, run), *recorded_only(scenario, run))
            if stream.topic in recording.types
        }
        """By topic."""

        self.refused = 0
        """Messages that are not what their topic says."""

    def play(self, from_nanos: int) -> Iterator[Due]:
        """Return what is due from an instant on, in that order."""
        return itertools.dropwhile(
            lambda due: not isinstance(due.message, Clock), self._sorted(from_nanos)
        )

    def _sorted(self, from_nanos: int) -> Iterator[Due]:
        waiting: list[Due] = []
        numbers = itertools.count()
        epoch = self._recording.run.epoch_nanos
        for recorded in self._recording.read(list(self.streams), from_nanos=from_nanos):
            while waiting and waiting[0].nanos < recorded.nanos:
                yield heapq.heappop(waiting)
            stream = self.streams[recorded.topic]
            try:
                message = from_cdr(recorded.cdr, stream.message, Moment(recorded.nanos, epoch))
            except BadMessage:
                self.refused += 1
                continue
            if isinstance(message, Reading):
                error = message.stamp_nanos - recorded.nanos  # type: ignore[attr-defined]
                message = replace(message, clock_error_nanos=error)
            rank = 0 if stream.message is Clock else 1
            due_nanos = recorded.nanos + _takes_nanos(stream)
            heapq.heappush(waiting, Due(due_nanos, rank, next(numbers), stream.key, message))
        while waiting:
            yield heapq.heappop(waiting)


def _takes_nanos(stream: RosStream) -> int:
    """Return how long one message of a stream is measured, from its stamp on."""
    if stream.message is PointCloud and isinstance(stream, Outgoing):
        return round(NANOS / stream.declared_hz)
    return 0
