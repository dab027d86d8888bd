# SPDX-License-Identifier: Apache-2.0
"""Messages of a repeated run, from the messages of its bus: as a recorder would have written them.

The readings of a sensor are complete up to the tick that it has settled. Up to there, messages are
sorted by their log time.
"""

import math
from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from operator import attrgetter

from groundlink.bus.core_topics import ACK, STATE
from groundlink.bus.pipe import PipedMessage
from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack, BadBusMessage, BusMessage, State, decode, measured_nanos
from groundlink.ros.base import Bases
from groundlink.ros.cdr import ros_type_of, to_cdr
from groundlink.ros.streams import RosStream, outgoing, recorded_only
from groundlink.scenario import Scenario

from .reader import RecordedMessage

TIMEOUT_NANOS = 5 * NANOS
"""Simulation time after the end for which late sensors are awaited."""


class RepeatedReadings:
    """Readings of some sensors of a repeated run, and what base drivers make of them.

    Parameters
    ----------
    scenario
        of the repeated run.
    run
        name of the repeated run.
    epoch_nanos
        stamp of its tick 0.

    Attributes
    ----------
    types
        ROS type by topic, of all topics of the run.
    declared_hz
        rate by topic; None if it is not known.
    """

    def __init__(self, scenario: Scenario, run: str, epoch_nanos: int) -> None:
        self._run, self._epoch_nanos = run, epoch_nanos
        truth_hz = min((vehicle.ground_truth.rate_hz for vehicle in scenario.vehicles), default=1.0)
        self._lag_nanos = math.ceil(NANOS / truth_hz)
        """Longest time by which base drivers wait for the ground truth of a reading."""

        self._reached: dict[str, int] = {}
        """By key: the stamp of the newest message."""

        streams = (*outgoing(scenario, run), *recorded_only(scenario, run))
        self._streams = {stream.key: stream for stream in streams}
        self._bases = Bases(scenario, run, truth=True)
        self.types = {s.topic: ros_type_of(s.message, s.ros_type) for s in streams}
        self.declared_hz: dict[str, float | None] = {s.topic: s.declared_hz for s in streams}
        for made in self._bases.topics:
            self.types[made.topic] = ros_type_of(made.message)
            so_far = self.declared_hz.get(made.topic) or 0.0
            self.declared_hz[made.topic] = so_far + made.declared_hz
        for topic, message in self._bases.latched.items():
            self.types[topic] = ros_type_of(message)

    def latched(self, stamp_nanos: int) -> Iterator[RecordedMessage]:
        """Yield static transforms and robot descriptions."""
        for topic, message, _ in self._bases.still(stamp_nanos):
            yield from self._recorded(topic, stamp_nanos, message)

    def read(
        self,
        messages: Iterable[PipedMessage],
        topics: Collection[str],
        sensors: Collection[str],
        until_nanos: int,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of some topics in order of log time, then of topic.

        Ends when the sensors have settled `until_nanos`, or when physics is long past it.

        Parameters
        ----------
        messages
            messages of the repeated run from its start.
        topics
            topics to yield.
        sensors
            names of the sensors that run, as `vehicle/sensor`.
        until_nanos
            log time of the first message that is not yielded.
        """
        needs_bases = not {each.topic for each in self._bases.topics}.isdisjoint(topics)
        lag_nanos = self._lag_nanos if needs_bases else 0
        ack_keys = {ACK.key_in(self._run, process=name): name for name in sensors}
        settled_nanos = dict.fromkeys(sensors, 0)
        states, given_up_nanos = STATE.key_in(self._run), self.given_up_nanos(until_nanos)
        waiting: list[RecordedMessage] = []
        for key, payload in messages:
            if key == states:
                if decode(payload, State).stamp_nanos >= given_up_nanos:
                    break
            elif key in ack_keys:
                ack = decode(payload, Ack)
                settled_nanos[ack_keys[key]] = self._epoch_nanos + ack.settled_tick * TICK_NANOS
                complete_nanos = min(settled_nanos.values()) - lag_nanos
                if complete_nanos >= until_nanos:
                    break
                waiting.sort(key=_order)
                count = bisect_left(waiting, complete_nanos, key=attrgetter("nanos"))
                yield from waiting[:count]
                del waiting[:count]
            elif (stream := self._streams.get(key)) is not None and (
                needs_bases or stream.topic in topics
            ):
                waiting += (
                    each for each in self._taken(key, stream, payload) if each.topic in topics
                )
        else:
            raise UserError("the repeated run ended before its sensors had measured all")
        waiting.sort(key=_order)
        yield from (message for message in waiting if message.nanos < until_nanos)

    def given_up_nanos(self, until_nanos: int) -> int:
        """Return the stamp of the state at which `read` ends, whatever sensors have settled."""
        return until_nanos + self._lag_nanos + TIMEOUT_NANOS

    def _taken(self, key: str, stream: RosStream, payload: bytes) -> Iterator[RecordedMessage]:
        """Yield a message of the bus and what follows from it."""
        message = decode(payload, stream.message)
        stamp_nanos = measured_nanos(message)
        if stamp_nanos <= self._reached.get(key, self._epoch_nanos - 1):
            return  # Recorders drop what is not newer.
        self._reached[key] = stamp_nanos
        yield from self._recorded(stream.topic, stamp_nanos, message)
        for topic, made, nanos in self._bases.receive(key, message):
            yield from self._recorded(topic, nanos, made)

    def _recorded(self, topic: str, nanos: int, message: BusMessage) -> Iterator[RecordedMessage]:
        with suppress(BadBusMessage):
            yield RecordedMessage(nanos, topic, self.types[topic], bytes(to_cdr(message)))


def _order(message: RecordedMessage) -> tuple[int, str, bytes]:
    return message.nanos, message.topic, message.cdr
