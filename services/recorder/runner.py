# SPDX-License-Identifier: Apache-2.0
"""A recorder on the bus: takes what a run says, and is waited for as a sensor is.

Rule: everything that is not what becomes of the messages, which is its keeper's business.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Iterable
from typing import Protocol

from groundlink.bus.core_topics import ACK, HEALTH, RECORDER
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import history_key
from groundlink.bus.session import Bus
from groundlink.core.backoff import Backoff
from groundlink.messages.base import Ack, Clock, Health, Message, State, decode
from groundlink.process.joining import Heartbeat
from groundlink.ros.streams import incoming, outgoing, recorded_only
from groundlink.scenario import Scenario

from .recorder import Recorder, RecordingFile

NAME = RECORDER

MESSAGES_KEPT = 8192
"""Messages of the bus that may wait: some seconds of all streams together."""

COMMIT_SECONDS = 0.4
"""Between two moments at which the file is whole with all that has come: what a kill may cost."""

REST_SECONDS = 0.04
"""Between two looks at what has come: to be woken by each message costs more than to write it."""


class RecordingFiles(Protocol):
    """Who has the files."""

    def begin(self, epoch_nanos: int) -> RecordingFile:
        """Return the next one, for another life of physics."""

    def tend(self, recorder: Recorder) -> None:
        """Do what is due every `COMMIT_SECONDS`."""

    def finish(self, recorder: Recorder) -> None:
        """Complete the file of a life that is over."""


def record(
    bus: Bus,
    scenario: Scenario,
    run: str,
    keeper: RecordingFiles,
    duration_nanos: int | None,
    stop: threading.Event,
    *,
    absent: Collection[str] = (),
    ordered: bool = False,
) -> None:
    """Write file after file, one for each life of physics, until `stop` or the duration's end.

    Parameters
    ----------
    absent
        sensors for which nobody shall wait.
    ordered
        whether the keeper writes in an order that does not depend on arrival: the recorder then
        takes acknowledgements of sensors, and no health, which measures the machine.
    """

    def new(early: Iterable[tuple[str, Message]] = ()) -> Recorder:
        return Recorder(
            *(scenario, run, keeper.begin),
            duration_nanos=duration_nanos,
            early=early,
            absent=absent,
            acknowledging=scenario.sensor_names() if ordered else (),
            dropped=inbox.dropped_of,
        )

    inbox: BusInbox[Message] = BusInbox(depth=MESSAGES_KEPT)
    recorder = new()
    streams = (*outgoing(scenario, run), *recorded_only(scenario, run), *incoming(scenario, run))
    for stream in streams:
        bus.subscribe(stream.key, stream.message, inbox)
    row = ACK if ordered else HEALTH
    bus.subscribe(row.key_in(run), row.message, inbox)
    ack_prefix = ACK.key_in(run, process="")
    heartbeat = Heartbeat(bus, run, NAME)
    publishers = [
        bus.publisher(ACK.key_in(run, process=name), ACK.delivery) for name in (NAME, *absent)
    ]

    def acknowledge(life: int, tick: int) -> None:
        for publish in publishers:
            publish(Ack(life, tick, tick))

    def tell_where() -> None:
        """Acknowledge what physics has come to: it begins, or goes on, when it hears of this."""
        if missed := list(bus.query(history_key(run), NAME, seconds=2.0).values()):
            tick = decode(missed[-1], State).tick if len(missed) > 1 else -1
            acknowledge(decode(missed[0], Ack).life, tick)

    tell_where()
    backoff = Backoff(time.monotonic())
    next_commit = 0.0
    try:
        while not stop.wait(REST_SECONDS) and not recorder.is_complete:
            while len(inbox) and not recorder.is_complete:
                arrived = inbox.get(seconds=0)
                if arrived is None:
                    break
                key, message = arrived
                if isinstance(message, Health):
                    recorder.heard(message)
                    continue
                if isinstance(message, Ack):
                    recorder.acknowledged(key.removeprefix(ack_prefix), message)
                    continue
                if recorder.is_another_life(message):
                    keeper.finish(recorder)
                    recorder = new(recorder.early)
                recorder.take(key, message)
                if isinstance(message, Clock):
                    acknowledge(message.life, message.tick)
                    backoff.reset(time.monotonic())
            if scenario.time.mode != "realtime" and backoff.is_due(time.monotonic()):
                tell_where()  # The bus loses what comes while a process is cut off.
            if (now := time.monotonic()) >= next_commit:
                keeper.tend(recorder)
                next_commit = now + COMMIT_SECONDS
            if heartbeat.due():
                heartbeat.beat(_tick(recorder), _counts(recorder, inbox))
        heartbeat.beat(_tick(recorder), _counts(recorder, inbox))
    finally:
        keeper.finish(recorder)


def _tick(recorder: Recorder) -> int:
    return recorder.clock.tick if recorder.clock else -1


def _counts(recorder: Recorder, inbox: BusInbox[Message]) -> dict[str, int]:
    return recorder.counts | {
        "bytes": recorder.file.size_bytes if recorder.file else 0,
        "bus_dropped": inbox.dropped,
        "bus_refused": inbox.refused,
    }
