# SPDX-License-Identifier: Apache-2.0
"""Replay process, started with ``python -m services.replay``: publishes a recorded run.

It replaces physics and the sensors. Processes that acknowledge the clock, such as the gateway and a
recorder, are awaited when they are more than the scenario's window behind, so no message is lost.

With `--loop` the stamps repeat, as with ``ros2 bag play --loop``. The clock jumps back first.
"""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from msgspec.structs import replace

from groundlink.bus.core_topics import ACK, HEALTH, REPLAY, TIME_KEEPERS, Delivery
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import scenario_key
from groundlink.bus.session import Bus
from groundlink.bus.zenoh_config import DEFAULT_ENDPOINT
from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.core.extras import process_needs
from groundlink.messages.base import Ack, BusMessage, Clock
from groundlink.process import asset_exchange
from groundlink.process import runner as process
from groundlink.process.joining import Heartbeat, report_missing_kinds
from groundlink.ros.streams import incoming, outgoing, recorded_only
from groundlink.scenario import Scenario

NAME = REPLAY

with process_needs(NAME, "record"):
    from groundlink.recording.playback import Playback
    from groundlink.recording.reader import Recording

JUMP_SECONDS = 0.1
"""Pause after a clock that jumps back. Streams are not ordered among each other, and receivers drop
older readings until they have seen the jump."""

CATCH_UP_SECONDS = 0.2
"""Longer delays are not made up for: the replay takes longer."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Replay until the recording's end, or in a loop until `stop` is set."""
    parser = process.parser(NAME, "Publish a recorded run on the bus at its recorded pace.")
    parser.add_argument("recording", type=Path, metavar="RUN.mcap")
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help=f"endpoint to listen on as a router (default {DEFAULT_ENDPOINT} without --connect)",
    )
    parser.add_argument(
        "--factor", type=float, default=1.0, metavar="F", help="speed, as a multiple of real time"
    )
    parser.add_argument(
        "--from",
        type=float,
        default=0.0,
        metavar="S",
        dest="start",
        help="start S seconds into the run",
    )
    parser.add_argument("--loop", action="store_true", help="start again at the end")
    parser.add_argument(
        "--wait-for",
        metavar="PROCESS",
        action="append",
        default=[],
        help="start when this process has joined, such as gateway; repeatable",
    )
    parser.add_argument(
        "--delay",
        type=float,
        default=0.0,
        metavar="S",
        help="wait S seconds before the first message",
    )
    parser.add_argument(
        "--gateway", metavar="SCENARIO", help="use the gateway settings of this scenario"
    )
    options = parser.parse_args(arguments)
    with Recording(options.recording) as recording:
        length = (recording.last_nanos - recording.first_nanos) / NANOS
        if not options.factor > 0:
            raise UserError(f"--factor {options.factor:g}: expected more than 0")
        if not 0 <= options.start < max(length, 1e-9):
            raise UserError(f"--from {options.start:g}: the recording has {length:.1f} s")
        run = options.run or recording.run.run
        scenario = _as_served(recording.run.scenario, options.gateway)
        report_missing_kinds("replay", scenario)
        listen = options.listen or (None if options.connect else DEFAULT_ENDPOINT)
        with Bus(connect=options.connect, listen=listen) as bus:
            for name in TIME_KEEPERS:
                if bus.present(HEALTH.key_in(run, process=name), seconds=1.0):
                    raise UserError(
                        f"run `{run}` is already on the bus. Fix: end it or use another --run"
                    )
            asset_exchange.serve(bus, run, lambda: scenario)
            bus.serve(scenario_key(run), lambda _: [msgspec.msgpack.encode(scenario)])
            participants = _Participants(bus, run, scenario.time.window_ticks)
            replay = _Replay(bus, run, playback(recording, run), participants, options.factor, stop)
            while not participants.are_there(set(options.wait_for)) and not stop.is_set():
                replay.pause(0.02)
            replay.pause(options.delay)
            from_nanos = recording.first_nanos + round(options.start * NANOS)
            while not stop.is_set():
                replay.once(from_nanos)
                if not options.loop:
                    break
            replay.beat()


def playback(recording: Recording, run: str) -> Playback:
    """Return the playback of commands and of all that physics and sensors published.

    Other messages from ROS are left out: the stack under test publishes them again.
    """
    scenario = recording.run.scenario
    commands = [stream for stream in incoming(scenario, run) if stream.is_command]
    streams = (*commands, *outgoing(scenario, run), *recorded_only(scenario, run))
    return Playback(recording, streams)


def _as_served(scenario: Scenario, gateway: str | None) -> Scenario:
    """Return the scenario to serve: a fast run, whose stamps do not follow the wall clock."""
    scenario = replace(scenario, time=replace(scenario.time, mode="fast"))
    if gateway is None:
        return scenario
    from groundlink.loader import load  # loaded only where a file is read

    return replace(scenario, gateway=load(gateway).gateway)


class _Participants:
    """The other processes of the run and their progress."""

    def __init__(self, bus: Bus, run: str, window_ticks: int) -> None:
        self._window = window_ticks
        self._there: set[str] = set()
        self._reached: dict[str, int] = {}
        self._acks: BusInbox[Ack] = BusInbox(depth=1024)
        self._health_prefix = HEALTH.key_in(run, process="")
        self._ack_prefix = ACK.key_in(run, process="")
        bus.subscribe(ACK.key_in(run), Ack, self._acks)
        bus.watch(HEALTH.key_in(run), self._on_change)

    def are_there(self, names: set[str]) -> bool:
        """Return whether all these processes have joined."""
        return names <= self._there

    def follow(self, tick: int) -> bool:
        """Return whether all acknowledging processes are within the window of this tick."""
        while len(self._acks) and (arrived := self._acks.get(seconds=0)):
            self._reached[arrived[0].removeprefix(self._ack_prefix)] = arrived[1].tick
        return all(
            reached >= tick - self._window
            for name, reached in self._reached.items()
            if name in self._there
        )

    def forget(self) -> None:
        """Forget all progress, before ticks jump back."""
        self._reached.clear()

    def _on_change(self, key: str, is_there: bool) -> None:
        name = key.removeprefix(self._health_prefix)
        self._there = self._there | {name} if is_there else self._there - {name}


@dataclass
class _Replay:
    """Publishes a recording."""

    bus: Bus
    run: str
    player: Playback
    participants: _Participants
    factor: float
    stop: threading.Event

    def __post_init__(self) -> None:
        streams = self.player.streams.values()
        # A replay can wait, so no message needs to be dropped.
        self._publish: dict[str, Callable[[BusMessage], bytes]] = {
            stream.key: self.bus.publisher(stream.key, Delivery.ALL) for stream in streams
        }
        self._heartbeat = Heartbeat(self.bus, self.run, NAME)
        self._tick = -1
        self._counts = {"published": 0, "rounds": 0, "refused": 0}

    def once(self, from_nanos: int) -> None:
        """Publish the recording from an instant to its end."""
        begin: float | None = None
        jumps = self._counts["rounds"] > 0
        self.participants.forget()
        for due in self.player.play(from_nanos):
            if begin is None:
                begin, first_nanos = time.monotonic(), due.nanos
            seconds = (due.nanos - first_nanos) / NANOS / self.factor
            ahead = begin + seconds - time.monotonic()
            if ahead < -CATCH_UP_SECONDS:
                begin -= ahead
            self.pause(ahead)
            while not self.participants.follow(self._tick) and not self.stop.is_set():
                self.pause(0.002)
            if self.stop.is_set():
                return
            if isinstance(due.message, Clock):
                self._tick = due.message.tick
            self._publish[due.key](due.message)
            self._counts["published"] += 1
            if jumps:
                self.pause(JUMP_SECONDS)
                begin += JUMP_SECONDS
                jumps = False
        self._counts["rounds"] += 1

    def pause(self, seconds: float) -> None:
        """Wait, and publish health meanwhile."""
        until = time.monotonic() + seconds
        while True:
            if self._heartbeat.due():
                self.beat()
            remaining = until - time.monotonic()
            if remaining <= 0 or self.stop.wait(min(remaining, 0.05)):
                return

    def beat(self) -> None:
        """Publish health."""
        self._counts["refused"] = self.player.refused
        self._heartbeat.beat(self._tick, self._counts)


if __name__ == "__main__":
    process.run(NAME, main)
