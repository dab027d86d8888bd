# SPDX-License-Identifier: Apache-2.0
"""Viewer process, started with ``python -m services.view``: shows a run without delaying it.

With a recording as its argument it shows that file instead, as fast as it can be read.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from groundlink.bus.session import Bus
from groundlink.cli.files.view import add_arguments
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.messages.base import BusMessage, Health, State
from groundlink.process import runner as process
from groundlink.process.joining import Heartbeat, changed_world, join_world, report_missing_kinds
from groundlink.ros.streams import RosStream
from groundlink.scenario import Scenario
from groundlink.scene.build import world_hash

from .viewer_subscriptions import ViewerSubscriptions

if TYPE_CHECKING:
    from groundlink.recording.reader import Recording

    from .recorded.show import ViewedRecording

NAME = "view"

FRAME_SECONDS = 1 / 30
"""Interval at which inboxes are read."""

END_SECONDS = 1.0
"""Longest time from a signal to the end of the process, even if Rerun hangs."""

WEB_PORT = 9090
FOXGLOVE_PORT = 8765
FOXGLOVE_LINE = "view: open ws://{host}:{port} in Foxglove or Lichtblick"


class RunView(Protocol):
    """A view of a run: Rerun or Foxglove."""

    def change(self, scenario: Scenario) -> None:
        """Show another world from now on, after something was added or removed."""

    def take_states(self, states: Sequence[State]) -> None:
        """Take states, oldest first."""

    def begin_again(self) -> None:
        """Expect states from the start once more, only to place further messages."""

    def take(self, path: str, stream: RosStream, message: BusMessage) -> None:
        """Take a message of a stream."""

    def take_health(self, health: Health, now_seconds: float) -> None:
        """Take the health of a process, received at a time of the wall clock."""

    def show_text(self, text: str) -> None:
        """Show a text in Markdown."""

    def flush(self) -> None:
        """Show all messages taken."""

    def alive(self) -> bool:
        """Return whether the view is still open."""

    def counters(self) -> dict[str, int]:
        """Return counters for health."""

    def close(self) -> None:
        """End."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Show a run until `stop` is set or the viewer is closed."""
    parser = process.parser(NAME, "Show a run in Rerun, or serve it to Foxglove.")
    add_arguments(parser)
    parser.add_argument(
        "--scenario",
        type=Path,
        metavar="FILE",
        help="scenario in MessagePack whose sensors are simulated on the recorded drive",
    )
    options = parser.parse_args(arguments)
    if options.recording is not None:
        _show_file(options, stop)
        return
    with Bus(connect=process.endpoint(options), observer=True, name=NAME) as bus:
        run, scenario = join_world(bus, options.run, stop)
        report_missing_kinds("view", scenario)
        intake = ViewerSubscriptions(bus, scenario, run)
        view = _view(options, scenario, run, intake.streams)
        if options.save is None:
            _end_in_time()
        heartbeat = Heartbeat(bus, run, f"{NAME}/{os.getpid()}")
        tick, world = -1, world_hash(scenario)
        try:
            due = time.monotonic()
            while not stop.wait(max(0.0, due - time.monotonic())) and view.alive():
                due = max(due + FRAME_SECONDS, time.monotonic())
                states, messages = intake.take()
                if states and states[-1].world_hash != world:
                    world = states[-1].world_hash
                    changed = changed_world(bus, run, world)
                    if changed is not None and changed != scenario:
                        scenario = changed
                        view.change(scenario)
                view.take_states(states)
                tick = states[-1].tick if states else tick
                for path, stream, message in messages:
                    view.take(path, stream, message)
                for health in intake.health():
                    view.take_health(health, time.monotonic())
                view.flush()
                if heartbeat.due():
                    heartbeat.beat(tick, intake.counters() | view.counters())
        finally:
            view.close()


def _show_file(options: argparse.Namespace, stop: threading.Event) -> None:
    """Show a recording, until `stop` is set or the viewer is closed.

    Raises
    ------
    UserError
        when it cannot be read, or is asked to be served to Foxglove.
    """
    try:
        from groundlink.recording.reader import Recording

        from .recorded.show import ViewedRecording
    except ModuleNotFoundError as error:
        raise UserError(
            f"viewing a recording needs `{error.name}`. Fix: pip install 'groundlink[record,view]'"
        ) from None
    if options.foxglove and options.scenario is None:
        raise UserError(f"--foxglove: Foxglove opens {options.recording} itself; expected no file")
    with Recording(options.recording) as recording:
        recorded = ViewedRecording(recording, options.scenario)
        if options.foxglove:
            _play(options, recording, recorded, stop)
            return
        view = _view(options, recorded.scenario, recorded.run, recorded.streams, whole=True)
        if options.save is None:
            _end_in_time()
        try:
            if recorded.show(view, stop) and options.save is None:
                while not stop.wait(FRAME_SECONDS) and view.alive():
                    pass
        finally:
            view.close()


def _play(
    options: argparse.Namespace,
    recording: Recording,
    recorded: ViewedRecording,
    stop: threading.Event,
) -> None:
    """Serve a recording to Foxglove; its further sensors are simulated on request."""
    with needs("view"):
        from .recorded.foxglove_playback import FoxglovePlayback

    host, port = options.host, options.port or FOXGLOVE_PORT
    with tempfile.TemporaryDirectory(prefix="groundlink-view-") as folder:
        playback = FoxglovePlayback(
            *(recording, recorded, Path(folder), host, port), lambda line: print(line, flush=True)
        )
        print(FOXGLOVE_LINE.format(host=host, port=port), flush=True)
        try:
            playback.run(stop, time.monotonic)
        finally:
            playback.close()


def _view(
    options: argparse.Namespace,
    scenario: Scenario,
    run: str,
    streams: Mapping[str, RosStream],
    *,
    whole: bool = False,
) -> RunView:
    """Return the view that the options select, and print how to open it."""
    with needs("view"):
        if options.foxglove:
            from .foxglove_server import FoxgloveServer

            port = options.port or FOXGLOVE_PORT
            server = FoxgloveServer(scenario, run, streams, options.host, port)
            print(FOXGLOVE_LINE.format(host=options.host, port=port), flush=True)
            return server
        from . import layout, rerun_destinations
        from .rerun_view import RerunView
    blueprint = layout.layout(scenario, streams, whole=whole)
    destination: rerun_destinations.RerunDestination
    has_screen = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if options.save:
        destination = rerun_destinations.RerunFile(options.save, blueprint)
        print(f"view: writing {options.save}; open it with: rerun {options.save}", flush=True)
    elif options.web or not has_screen:
        port = options.port or WEB_PORT
        _need_free(options.host, port)
        destination, address = rerun_destinations.web(
            *(blueprint, options.host, _free_port(), port),
            machine=socket.gethostname(),
            whole=whole,
        )
        print(f"view: open {address}", flush=True)
    else:
        destination = rerun_destinations.window(blueprint, _free_port(), whole=whole)
    return RerunView(scenario, run, coloring=options.color, destination=destination)


def _end_in_time() -> None:
    """End this process soon after a signal, even while it is blocked.

    A viewer that hangs takes nothing any more. Then a call that logs does not return, and Python,
    which handles signals between its instructions, handles none; the kernel's wakeup comes anyway.
    The viewer's own process ends with this one. For a file there is no such haste.
    """
    awake, wakeup = socket.socketpair()
    wakeup.setblocking(False)
    signal.set_wakeup_fd(wakeup.detach())

    def watch() -> None:
        awake.recv(1)
        time.sleep(END_SECONDS)
        os._exit(0)

    threading.Thread(target=watch, name="end", daemon=True).start()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _need_free(host: str, port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            why = (error.strerror or str(error)).lower()
            raise UserError(
                f"cannot serve on {host}:{port}: {why}. Fix: choose another port with --port"
            ) from None


if __name__ == "__main__":
    process.run(NAME, main)
