# SPDX-License-Identifier: Apache-2.0
"""Recorder on the bus: passes messages of a run to a `Recorder`, and acknowledges the clock.

A fast run waits for these acknowledgements as it does for those of sensors.
"""

import threading
import time
from collections.abc import Collection, Iterable
from typing import Protocol

from groundlink.bus.core_topics import ACK, HEALTH, RECORDER, ROOT, STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import history_key
from groundlink.bus.session import Bus
from groundlink.core.backoff import Backoff
from groundlink.messages.base import Ack, BusMessage, Clock, Health, State, decode
from groundlink.process.joining import Heartbeat
from groundlink.ros.streams import incoming, outgoing, recorded_only, waiting_messages
from groundlink.scenario import Scenario

from .recorder import Recorder, RecordingFile, participants

NAME = RECORDER

COMMIT_SECONDS = 0.4
"""Interval at which the file is made complete: the most that a killed recorder loses."""

REST_SECONDS = 0.04
"""Interval at which the inbox is read: waking up for each message costs more than writing it."""


class RecordingFiles(Protocol):
    """The files of a recording, one for each episode."""

    def begin(self, epoch_nanos: int) -> RecordingFile:
        """Return the file of the next episode."""

    def tend(self, recorder: Recorder) -> None:
        """Do what is due every `COMMIT_SECONDS`."""

    def finish(self, recorder: Recorder) -> None:
        """Complete the file of an ended episode."""


class BusRecorder:
    """Records a run, with a `Recorder` for each episode.

    Parameters
    ----------
    absent
        sensors and drivers that do not run: the recorder acknowledges in their place.
    ordered
        whether the files have an order that does not depend on arrival. The recorder then takes
        acknowledgements of all processes, whose order among other messages tells what has come,
        and no health, which depends on the machine.
    """

    def __init__(
        self,
        bus: Bus,
        scenario: Scenario,
        run: str,
        files: RecordingFiles,
        duration_nanos: int | None,
        *,
        absent: Collection[str] = (),
        ordered: bool = False,
    ) -> None:
        self._bus, self._scenario, self._run, self._files = bus, scenario, run, files
        self._duration_nanos, self._absent = duration_nanos, absent
        awaited = participants(scenario) if ordered else {}
        self._participants = {n: each for n, each in awaited.items() if n not in absent}
        self._inbox: BusInbox[BusMessage] = BusInbox(depth=waiting_messages(scenario, run))
        self._recorder = self._new_recorder()
        streams = (
            *outgoing(scenario, run),
            *recorded_only(scenario, run),
            *incoming(scenario, run),
        )
        if ordered:
            types: dict[str, type[BusMessage]] = {s.key: s.message for s in streams}
            types[STATE.key_in(run)] = State
            types |= {ACK.key_in(run, process=name): Ack for name in self._participants}
            bus.subscribe_in_order(f"{ROOT}/{run}/**", types.get, self._inbox)
        else:
            for stream in streams:
                bus.subscribe(stream.key, stream.message, self._inbox)
            bus.subscribe(HEALTH.key_in(run), HEALTH.message, self._inbox)
        self._ack_prefix = ACK.key_in(run, process="")
        self._heartbeat = Heartbeat(bus, run, NAME)
        self._publishers = [
            bus.publisher(ACK.key_in(run, process=name), ACK.delivery) for name in (NAME, *absent)
        ]
        self._acknowledged = Ack(-1, -1, -1)
        self._acknowledge_history()
        self._backoff = Backoff(time.monotonic())

    def record(self, stop: threading.Event) -> None:
        """Record until `stop` is set or the duration is over; the inbox is then empty."""
        next_commit = 0.0
        is_stopped = False
        try:
            while not is_stopped and not self._recorder.is_complete:
                is_stopped = stop.wait(REST_SECONDS)
                while len(self._inbox) and not self._recorder.is_complete:
                    if (arrived := self._inbox.get(seconds=0)) is None:
                        break
                    self._take(*arrived)
                self._acknowledge_taken()
                is_fast = self._scenario.time.mode != "realtime"
                if is_fast and self._backoff.is_due(time.monotonic()):
                    self._acknowledge_history()  # acknowledgements may be lost on the bus
                if (now := time.monotonic()) >= next_commit:
                    self._files.tend(self._recorder)
                    next_commit = now + COMMIT_SECONDS
                if self._heartbeat.due():
                    self._beat()
            self._beat()
        finally:
            self._files.finish(self._recorder)

    def _new_recorder(self, early: Iterable[tuple[str, BusMessage]] = ()) -> Recorder:
        return Recorder(
            *(self._scenario, self._run, self._files.begin),
            duration_nanos=self._duration_nanos,
            early=early,
            absent=self._absent,
            acknowledging=self._participants,
            dropped=self._inbox.dropped_of,
        )

    def _take(self, key: str, message: BusMessage) -> None:
        if isinstance(message, Health):
            self._recorder.take_health(message)
            return
        if isinstance(message, Ack):
            self._recorder.acknowledged(key.removeprefix(self._ack_prefix), message)
            return
        if isinstance(message, State):
            self._recorder.take_state(message)
            return
        if self._recorder.is_another_episode(message):
            self._files.finish(self._recorder)
            self._recorder = self._new_recorder(self._recorder.early)
        self._recorder.take(key, message)
        if isinstance(message, Clock):
            self._acknowledge(message.episode, message.tick)
            self._backoff.reset(time.monotonic())

    def _acknowledge(self, episode: int, tick: int) -> None:
        self._acknowledged = Ack(episode, tick, self._recorder.taken_tick(episode, tick))
        for publish in self._publishers:
            publish(self._acknowledged)

    def _acknowledge_taken(self) -> None:
        """Acknowledge the newest clock again if more messages up to it have been taken."""
        if (clock := self._recorder.clock) is not None:
            taken = self._recorder.taken_tick(clock.episode, clock.tick)
            if taken > self._acknowledged.settled_tick:
                self._acknowledge(clock.episode, clock.tick)

    def _acknowledge_history(self) -> None:
        """Acknowledge the newest tick of physics, which waits for this to begin or to continue."""
        if missed := list(self._bus.query(history_key(self._run), NAME, seconds=2.0).values()):
            tick = decode(missed[-1], State).tick if len(missed) > 1 else -1
            self._acknowledge(decode(missed[0], Ack).episode, tick)

    def _beat(self) -> None:
        recorder = self._recorder
        counts = recorder.counts | {
            "bytes": recorder.file.size_bytes if recorder.file else 0,
            "bus_dropped": self._inbox.dropped,
            "bus_refused": self._inbox.refused,
        }
        self._heartbeat.beat(recorder.clock.tick if recorder.clock else -1, counts)
