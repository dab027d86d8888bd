# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.recorder``: joins a run and writes it to a file."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from groundlink import process
from groundlink.bus import Bus
from groundlink.clock import NANOS
from groundlink.errors import UserError
from groundlink.inbox import Inbox
from groundlink.messages import Ack, Clock, Health, Message, State, decode
from groundlink.questions import history_key
from groundlink.recording.metadata import RUN_RECORD, facts, run_entries
from groundlink.recording.ros_channels import RosFile
from groundlink.ros_streams import incoming, outgoing, recorded_only
from groundlink.scenario import Scenario
from groundlink.topics import ACK, HEALTH

from .recorder import Recorder

NAME = "recorder"

MESSAGES_KEPT = 8192
"""Messages of the bus that may wait: some seconds of all streams together."""

COMMIT_SECONDS = 0.4
"""Between two moments at which the file is whole with all that has come: what a kill may cost."""


REST_SECONDS = 0.04
"""Between two looks at what has come: to be woken by each message costs more than to write it."""


class Files:
    """The files of a run: the one that was asked for, and one more for each new life of physics."""

    def __init__(self, path: Path, scenario: Scenario, run: str) -> None:
        self._wanted = path
        self._scenario = scenario
        self._run = run
        self.path = path

    def begin(self, epoch_nanos: int) -> RosFile:
        """Open the next file, whole and without messages; what exists is never overwritten."""
        for number in itertools.count(1):
            if number > 1:
                self.path = self._wanted.with_stem(f"{self._wanted.stem}_{number}")
            try:
                file = RosFile(self.path)
                break
            except FileExistsError:
                continue
        if self.path != self._wanted:
            print(f"{self._wanted} exists, so this goes to {self.path}", flush=True)
        run = facts(self._scenario, self._run, epoch_nanos)
        file.mcap.add_metadata(RUN_RECORD, run_entries(run))
        return file


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Record until `stop` is set or the duration is over."""
    parser = process.parser(
        NAME, "Write every stream of a run to an MCAP file with ROS 2 messages."
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.mcap", help="what to write"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="end after S s of sim time")
    options = parser.parse_args(arguments)
    if options.duration is not None and not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    duration = None if options.duration is None else round(options.duration * NANOS)
    with Bus(connect=process.endpoint(options), name=NAME) as bus:
        run, scenario = process.join(bus, options.run, stop)
        files = Files(options.out, scenario, run)
        try:
            _record(bus, scenario, run, files, duration, stop)
        except OSError as error:
            raise UserError(
                f"cannot write {files.path}: {(error.strerror or str(error)).lower()}"
            ) from None


def _record(
    bus: Bus,
    scenario: Scenario,
    run: str,
    files: Files,
    duration_nanos: int | None,
    stop: threading.Event,
) -> None:
    """Write file after file: one for each life of physics."""

    def new(early: Iterable[tuple[str, Message]] = ()) -> Recorder:
        return Recorder(scenario, run, files.begin, duration_nanos=duration_nanos, early=early)

    recorder = new()
    inbox: Inbox[Message] = Inbox(depth=MESSAGES_KEPT)
    streams = (*outgoing(scenario, run), *recorded_only(scenario, run), *incoming(scenario, run))
    for stream in streams:
        bus.subscribe(stream.key, stream.message, inbox)
    bus.subscribe(HEALTH.key_in(run), Health, inbox)
    heartbeat = process.Heartbeat(bus, run, NAME)
    acknowledge = bus.publisher(ACK.key_in(run, process=NAME), ACK.delivery)
    if missed := list(bus.ask(history_key(run), NAME, seconds=2.0).values()):
        # Physics that waits for this process begins, or goes on, when it hears that it is there.
        life = decode(missed[0], Ack).life
        tick = decode(missed[-1], State).tick if len(missed) > 1 else -1
        acknowledge(Ack(life, tick, tick))

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
                if recorder.is_another_life(message):
                    _finish(recorder, files)
                    recorder = new(recorder.early)
                recorder.take(key, message)
                if isinstance(message, Clock):
                    acknowledge(Ack(message.life, message.tick, message.tick))
            if (now := time.monotonic()) >= next_commit:
                recorder.commit()
                next_commit = now + COMMIT_SECONDS
            if heartbeat.due():
                heartbeat.beat(
                    recorder.clock.tick if recorder.clock else -1, _counts(recorder, inbox)
                )
        heartbeat.beat(recorder.clock.tick if recorder.clock else -1, _counts(recorder, inbox))
    finally:
        _finish(recorder, files)


def _counts(recorder: Recorder, inbox: Inbox[Message]) -> dict[str, int]:
    return recorder.counts | {
        "bytes": recorder.file.mcap.size_bytes if recorder.file else 0,
        "bus_dropped": inbox.dropped,
        "bus_refused": inbox.refused,
    }


def _finish(recorder: Recorder, files: Files) -> None:
    """Complete the file, if one was begun."""
    if recorder.file is not None:
        recorder.commit()
        size = recorder.file.mcap.size_bytes / 1e6
        recorder.file.mcap.close()
        print(f"wrote {files.path}: {recorder.counts['messages']} messages, {size:.1f} MB")


if __name__ == "__main__":
    process.run(NAME, main)
