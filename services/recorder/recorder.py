# SPDX-License-Identifier: Apache-2.0
"""Recorder: writes the messages of one episode to a file, from its first clock to its end.

Log times are simulation times: the stamp of a command, the measurement time of a reading, and the
newest clock for other messages from ROS. Messages that are derived for ROS (`groundlink.ros.base`)
are written with their source. A message that is not newer than the last one of its stream is
dropped, since restarted sensors repeat readings.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Protocol

from groundlink.bus.core_topics import GATEWAY, PHYSICS
from groundlink.bus.topics import STREAM_TOPICS, driver_name, sensor_outputs
from groundlink.core.clock import NANOS, TICK_NANOS, Schedule, exact
from groundlink.messages.base import (
    Ack,
    BadBusMessage,
    BusMessage,
    Clock,
    Health,
    State,
    measured_nanos,
)
from groundlink.ros.base import Bases, is_latched
from groundlink.ros.cdr import ros_type_of, to_cdr
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, diagnostics
from groundlink.ros.streams import RosStream, incoming, outgoing, recorded_only
from groundlink.scenario import Scenario
from groundlink.scenario.route import DRIVER_PERIOD_TICKS

DIAGNOSTICS_NANOS = NANOS
"""Simulation time between two diagnostics messages."""

EARLY_MESSAGES = 1024
"""Messages that may wait for their clock; beyond it the oldest are dropped."""

AHEAD_NANOS = NANOS // 2
"""A message this much ahead of the newest clock waits for its own clock: streams are not ordered
among each other, and it may be of another episode."""

TIMEOUT_NANOS = 5 * NANOS
"""Simulation time after the end for which late or absent sensors are awaited."""


class RecordingTopic(Protocol):
    """A topic of a recording file."""

    def write(self, nanos: int, cdr: memoryview) -> None:
        """Write a message; times of a topic never decrease."""


class RecordingFile(Protocol):
    """A file that a recorder writes: a `RosFile` or a stand-in."""

    @property
    def size_bytes(self) -> int:
        """Size on disk."""

    def topic(self, name: str, ros_type: str, *, latched: bool = False) -> RecordingTopic:
        """Return the topic of this name and type; it is declared at the first call."""

    def commit(self, declared_hz: Mapping[str, float | None]) -> None:
        """Make the file complete with all messages written."""

    def close(self) -> None:
        """Close it in the state of the last commit."""


@dataclass(frozen=True)
class Participant:
    """A process that acknowledges a tick after all messages that it sends up to that tick."""

    vehicle: str | None = None
    """The vehicle that it belongs to. It acknowledges nothing more once the vehicle is removed."""

    silent_ticks: int = 0
    """Ticks after an acknowledged tick in which it sends nothing."""


def participants(scenario: Scenario) -> dict[str, Participant]:
    """Return the processes that send what a recording has, by name."""
    found = {PHYSICS: Participant()}
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            found[f"{vehicle.name}/{sensor.name}"] = Participant(vehicle.name)
        if vehicle.route is not None:
            found[driver_name(vehicle)] = Participant(vehicle.name, DRIVER_PERIOD_TICKS - 1)
    if scenario.time.lockstep == "ros":
        found[GATEWAY] = Participant()
    return found


class Recorder:
    """Writes a run.

    Parameters
    ----------
    begin
        opens the file; called with the epoch at the first clock.
    duration_nanos
        simulation time after which the recording is complete; None for no end.
    early
        messages that arrived before the first clock: `early` of the recorder before.
    absent
        sensors, as `vehicle/sensor`, that do not run.
    acknowledging
        processes whose acknowledgements are passed to `acknowledged`, by name.
    dropped
        by key: messages that arrived faster than they could be taken; it is updated outside.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        begin: Callable[[int], RecordingFile],
        *,
        duration_nanos: int | None = None,
        early: Iterable[tuple[str, BusMessage]] = (),
        absent: Collection[str] = (),
        acknowledging: Mapping[str, Participant] = MappingProxyType({}),
        dropped: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        self._scenario = scenario
        self._clocks = Schedule.at(scenario.time.clock_rate_hz)
        self._dropped, self._dropped_before = dropped, Counter(dropped)
        self._begin = begin
        self._duration_nanos = duration_nanos
        self._outgoing: dict[str, RosStream] = {
            stream.key: stream
            for stream in (*outgoing(scenario, run), *recorded_only(scenario, run))
        }
        self._incoming = {stream.key: stream for stream in incoming(scenario, run)}
        self._bases = Bases(scenario, run, truth=True)
        of_others = {
            STREAM_TOPICS[extra.kind].key_in(run, vehicle=vehicle.name, sensor=extra.name)
            for vehicle in scenario.vehicles
            for extra in vehicle.streams
        }
        of_absent = {
            output.row.key_in(run, vehicle=found[0].name, sensor=found[1].name)
            for found in map(scenario.sensor, absent)
            if found
            for output in sensor_outputs(found[1])
        }
        self._period_nanos = {
            key: -int(-Fraction(NANOS) / exact(stream.declared_hz) // 1)
            for key, stream in self._outgoing.items()
            if stream.declared_hz is not None and key not in of_others | of_absent
        }
        """By stream that certainly has messages: not those of other processes, nor faults."""

        self._declared_hz = {s.topic: s.declared_hz for s in self._outgoing.values()}
        for each in self._bases.topics:
            so_far = self._declared_hz.get(each.topic) or 0.0
            self._declared_hz[each.topic] = so_far + each.declared_hz
        self._health: dict[str, Health] = {}
        self._file: RecordingFile | None = None
        self._early = deque(early, maxlen=EARLY_MESSAGES)
        """Messages that wait for their clock."""

        self._repeated: deque[tuple[str, BusMessage]] = deque(maxlen=EARLY_MESSAGES)
        """Messages since the newest clock that seemed to be repeated."""

        self._reached: dict[str, int] = {}
        """By stream: the stamp of the newest message."""

        self._participants = acknowledging
        self._acks = dict.fromkeys(acknowledging, Ack(-1, -1, -1))
        self._vehicles: Collection[str] | None = None
        """Vehicles of the newest state."""

        self._committed = 0
        self._first_nanos = 0
        self._next_diagnostics_nanos = 0
        self.clock: Clock | None = None
        """The newest; None before the first."""

        self.counts = dict.fromkeys(("messages", "repeated", "refused", "clocks_missed"), 0)

    @property
    def streams(self) -> list[RosStream]:
        """The recorded streams."""
        return [*self._outgoing.values(), *self._incoming.values()]

    @property
    def silent_ticks(self) -> int:
        """The longest time of a participant from an instant to its first message about it."""
        return max((each.silent_ticks for each in self._participants.values()), default=0)

    @property
    def file(self) -> RecordingFile | None:
        """The open file; None before the first clock."""
        return self._file

    @property
    def early(self) -> list[tuple[str, BusMessage]]:
        """Messages that may be of the next episode: newer than the clock, or apparently repeated.

        If both episodes have the same epoch, what overtakes the first clock of the next one looks
        like what a restarted sensor repeats.
        """
        return [*self._early, *self._repeated]

    @property
    def dropped(self) -> dict[str, int]:
        """By topic: messages that arrived faster than they could be taken."""
        topics = {stream.key: stream.topic for stream in self.streams}
        since = Counter(self._dropped) - self._dropped_before
        return {topics[key]: count for key, count in since.items() if key in topics}

    def take(self, key: str, message: BusMessage) -> None:
        """Write a message of one of the run's streams.

        Raises
        ------
        OSError
            when the file cannot be opened.
        """
        if isinstance(message, Clock):
            self._heard_clock(message)
            self._take(key, message)
            waiting = [*self._early]
            self._early.clear()
            for early in waiting:
                self.take(*early)
        elif self._file is None or self._outruns_clock(key, message):
            self._early.append((key, message))
        else:
            self._take(key, message)

    def _outruns_clock(self, key: str, message: BusMessage) -> bool:
        if key not in self._outgoing:
            return False
        assert self.clock is not None
        return measured_nanos(message) > self.clock.stamp_nanos + AHEAD_NANOS

    def _take(self, key: str, message: BusMessage) -> None:
        if (stream := self._incoming.get(key)) is not None:
            assert self.clock is not None
            # Commands have simulation time; other stamps from ROS may be of another clock.
            nanos = measured_nanos(message) if stream.is_command else self.clock.stamp_nanos
            self._write(key, message, max(nanos, self._first_nanos))
            return
        stamp = measured_nanos(message)
        if stamp <= self._reached.get(key, self._first_nanos - 1):
            self.counts["repeated"] += stamp >= self._first_nanos
            self._repeated.append((key, message))
            return
        self._reached[key] = stamp
        self._write(key, message, stamp)
        if self._is_beyond(stamp):
            return
        for topic, derived, nanos in self._bases.receive(key, message):
            self._put(topic, ros_type_of(type(derived)), nanos, derived)

    def take_health(self, health: Health) -> None:
        """Keep a health message for the next diagnostics."""
        self._health[health.process] = health

    def take_state(self, state: State) -> None:
        """Record how far physics has come: it publishes all else of a tick before the state."""
        self._vehicles = state.vehicles.keys()
        self.acknowledged(PHYSICS, Ack(state.episode, state.tick, state.tick))

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Record how far a process has come; its messages up to there were taken before."""
        if process in self._acks and self.clock and ack.episode == self.clock.episode:
            self._acks[process] = ack

    def _present(self) -> Iterator[tuple[Participant, Ack]]:
        """Yield each participant, but those of removed vehicles, with its acknowledgement."""
        for name, participant in self._participants.items():
            vehicle = participant.vehicle
            if vehicle is None or self._vehicles is None or vehicle in self._vehicles:
                yield participant, self._acks[name]

    def taken_tick(self, episode: int, tick: int) -> int:
        """Return the tick up to which all messages have been taken; -1 for none.

        Of each process these are the messages that it could send by then: a LiDAR has begun a
        revolution, but sends it only at its end.

        Parameters
        ----------
        tick
            newest tick of the episode.
        """
        reached = [
            max(ack.tick, ack.settled_tick) + participant.silent_ticks
            for participant, ack in self._present()
        ]
        if reached and (self.clock is None or self.clock.episode != episode):
            return -1
        return min((tick, *reached))

    def is_another_episode(self, message: BusMessage) -> bool:
        """Return whether a message is a clock of another episode."""
        if not isinstance(message, Clock) or self.clock is None:
            return False
        jumped_back = message.stamp_nanos < self.clock.stamp_nanos
        return jumped_back or message.episode != self.clock.episode

    @property
    def is_whole(self) -> bool:
        """Whether all streams of physics and sensors have reached the recording's end."""
        return self.end_nanos is not None and self._is_whole_to(self.end_nanos)

    def _is_whole_to(self, nanos: int) -> bool:
        if self.clock is None or self.clock.stamp_nanos < nanos:
            return False
        tick = (nanos - self.clock.epoch_nanos) / TICK_NANOS
        return all(
            ack.settled_tick + participant.silent_ticks >= tick
            for participant, ack in self._present()
        ) and all(
            self._reached.get(key, 0) + period_nanos >= nanos
            for key, period_nanos in self._period_nanos.items()
        )

    def has_come(self, nanos: int) -> bool:
        """Return whether no earlier message is awaited."""
        if self.clock is None:
            return False
        return self.clock.stamp_nanos >= nanos + TIMEOUT_NANOS or self._is_whole_to(nanos)

    @property
    def is_complete(self) -> bool:
        """Whether the recording has reached its end."""
        return self.end_nanos is not None and self.has_come(self.end_nanos)

    @property
    def first_nanos(self) -> int:
        """Stamp of the first clock; 0 before it."""
        return self._first_nanos

    @property
    def end_nanos(self) -> int | None:
        """First stamp that is not written; None without an end, and before the first clock."""
        if self._duration_nanos is None or self._file is None:
            return None
        return self._first_nanos + self._duration_nanos

    def commit(self, *, anyway: bool = False) -> None:
        """Make the file complete with all messages taken; `anyway`, also if there are none.

        Raises
        ------
        OSError
            when it cannot be written.
        """
        news = anyway or self.counts["messages"] != self._committed
        if self._file is not None and news:
            self._committed = self.counts["messages"]
            self._file.commit(self._declared_hz)

    def _heard_clock(self, clock: Clock) -> None:
        if self.clock is not None and self.clock.episode == clock.episode:
            self.counts["clocks_missed"] += self._clocks.between(self.clock.tick, clock.tick)
        self.clock = clock
        self._repeated.clear()
        if self._file is None:
            self._first_nanos = clock.stamp_nanos
            self._next_diagnostics_nanos = clock.stamp_nanos + DIAGNOSTICS_NANOS
            self._start(clock)
        while clock.stamp_nanos >= self._next_diagnostics_nanos:
            stamp = self._next_diagnostics_nanos
            self._next_diagnostics_nanos += DIAGNOSTICS_NANOS
            if self._health and not self._is_beyond(stamp):
                topic = self._topic(DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE)
                topic.write(stamp, diagnostics(stamp, self._health.values()))
                self.counts["messages"] += 1

    def _start(self, clock: Clock) -> None:
        """Open the file with all its topics, also those without messages."""
        self._file = self._begin(clock.epoch_nanos)
        for stream in self.streams:
            self._topic(stream.topic, ros_type_of(stream.message, stream.ros_type))
        for each in self._bases.topics:
            self._topic(each.topic, ros_type_of(each.message))
        for topic, derived, _ in self._bases.still(clock.epoch_nanos):
            self._put(topic, ros_type_of(type(derived)), clock.stamp_nanos, derived)

    def _write(self, key: str, message: BusMessage, nanos: int) -> None:
        stream = self._outgoing.get(key) or self._incoming[key]
        self._put(stream.topic, ros_type_of(stream.message, stream.ros_type), nanos, message)

    def _put(self, topic: str, ros_type: str, nanos: int, message: BusMessage) -> None:
        if self._is_beyond(nanos):
            return
        try:
            cdr = to_cdr(message)
        except BadBusMessage:
            self.counts["refused"] += 1
            return
        self._topic(topic, ros_type).write(nanos, cdr)
        self.counts["messages"] += 1

    def _topic(self, name: str, ros_type: str) -> RecordingTopic:
        assert self._file is not None
        return self._file.topic(name, ros_type, latched=is_latched(name))

    def _is_beyond(self, nanos: int) -> bool:
        end = self.end_nanos
        return end is not None and nanos >= end
