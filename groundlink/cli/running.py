# SPDX-License-Identifier: Apache-2.0
"""What commands share that start the processes of a run here: commands, supervision, a picture.

Rule: starts services only as ``python -m``. Whether a run is over and what it was worth is the
command's own business.
"""

from __future__ import annotations

import importlib.util
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from rich.console import Console, RenderableType
from rich.live import Live

from groundlink import topics
from groundlink.bus import DEFAULT_ENDPOINT
from groundlink.errors import UserError
from groundlink.inbox import Inbox
from groundlink.messages import Health
from groundlink.run_monitor import RunMonitor
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Gateway
from groundlink.supervisor import Supervisor
from groundlink.topics import process_names

PLAIN_PERIOD_SECONDS = 5.0
"""Between pictures where the output is no terminal."""

PLAIN_WIDTH = 110

RECORDER = topics.RECORDER

ROS_SIDE = "ros"
"""Name of the process that receives on the ROS side."""

SENSORS = "sensors"
"""Name of the process of all sensors where they share one."""

LISTEN_HELP = "where the run's router listens for its processes and for others (%(default)s)"

LISTEN_DEFAULT = DEFAULT_ENDPOINT


def console() -> Console:
    """Return where a command shows its picture."""
    return Console() if sys.stdout.isatty() else Console(width=PLAIN_WIDTH)


def commands(
    scenario: Scenario, file: str, run: str, endpoint: str, *, sensors_together: bool = False
) -> dict[str, list[str]]:
    """Return the command of every process of a run; sensors may share one."""
    found = {}
    modules = process_names(scenario)
    if sensors_together and (names := scenario.sensor_names()):
        modules = {n: m for n, m in modules.items() if n not in names}
        modules[SENSORS] = "services.sensors"
    for name, module in modules.items():
        arguments = [file] if name == "physics" else ["--name", name] if "/" in name else []
        found[name] = ["-m", module, *arguments, *joining(run, endpoint)]
    return found


def free_endpoint() -> str:
    """Return an endpoint at which nobody listens: other runs may go on beside this one."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def joining(run: str, endpoint: str) -> list[str]:
    """Return the arguments by which a process joins a run."""
    return ["--connect", endpoint, "--run", run]


def recorder(out: str, run: str, endpoint: str) -> list[str]:
    """Return the command of a recorder."""
    return ["-m", "services.recorder", "--out", out, *joining(run, endpoint)]


def check_new_file(option: str, path: Path) -> None:
    """Refuse to write where there is a file already, or no folder.

    Raises
    ------
    UserError
        when it is so.
    """
    if path.exists():
        raise UserError(f"{option} {path}: it exists already; delete it or choose another name")
    if not path.resolve().parent.is_dir():
        raise UserError(f"{option} {path}: there is no folder {path.parent}")


def ros_side(gateway: Gateway, shown: Console) -> list[str]:
    """Return the command that receives at the gateway's peer: the ROS 2 node where ROS is."""
    bind = ["--bind", gateway.peer]
    key = {"--key-file": gateway.key_file, "--key-env": gateway.key_env}
    bind += [word for name, value in key.items() if value is not None for word in (name, value)]
    if importlib.util.find_spec("rclpy") and importlib.util.find_spec("udp_bridge_ros2"):
        return ["-m", "udp_bridge_ros2", *bind]
    shown.print("no ROS 2 in this environment: a plain receiver stands in for the ROS node")
    return ["-m", "udp_bridge", "listen", *bind, "--report", "--quiet"]


def say(shown: Console) -> Callable[[str, str], None]:
    """Return what shows a line that a process printed."""
    return lambda name, line: shown.print(
        f"{name}: {line}", markup=False, highlight=False, soft_wrap=True
    )


def watch(
    supervisor: Supervisor,
    monitor: RunMonitor,
    inbox: Inbox[Health],
    stop: threading.Event,
    *,
    show: Callable[[bool], None],
    is_over: Callable[[], bool],
) -> str | None:
    """Tend a run until it is over; return the process that its user must mend, if any."""
    while not stop.is_set():
        if failed := supervisor.tend():
            return failed
        hear(monitor, inbox, stop)
        show(False)
        if is_over():
            break
    show(True)
    return None


def cannot_run(supervisor: Supervisor, name: str) -> int:
    """Say why a run is over that its user did not end; return the command's exit code."""
    if supervisor.children[name].ended_run:
        print(f"groundlink: {name} has ended the run; see its line above", file=sys.stderr)
        return 1
    print(f"groundlink: {name} cannot run; see its line above", file=sys.stderr)
    return UserError.exit_code


def hear(monitor: RunMonitor, inbox: Inbox[Health], stop: threading.Event) -> None:
    """Tell the monitor all that waits; wait a moment where nothing does."""
    while arrived := inbox.get(seconds=0.0 if len(inbox) else 0.05):
        monitor.heard(arrived[1], time.monotonic())
        if stop.is_set():
            break


def display(shown: Console, picture: Callable[[], RenderableType]) -> Callable[[bool], None]:
    """Return a function that shows the run now; its argument says whether it is the last time."""
    if shown.is_terminal:
        live = Live(console=shown, get_renderable=picture, refresh_per_second=4, transient=True)
        live.start()
        return lambda last: live.stop() if last else None
    next_print = time.monotonic() + PLAIN_PERIOD_SECONDS

    def show(last: bool) -> None:
        nonlocal next_print
        if not last and time.monotonic() >= next_print:
            next_print += PLAIN_PERIOD_SECONDS
            shown.print(picture())

    return show


def stop_on_signals() -> threading.Event:
    """Return an event that Ctrl-C and SIGTERM set."""
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    return stop
