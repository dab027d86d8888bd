# SPDX-License-Identifier: Apache-2.0
"""`groundlink up SCENARIO`: all processes of a run on this machine, supervised, with a live table.

Rule: starts services only as ``python -m``, so that what runs here also runs one by one elsewhere.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import msgspec
from rich.console import Console, RenderableType
from rich.live import Live

from groundlink import __version__
from groundlink.bus import DEFAULT_ENDPOINT, Bus
from groundlink.errors import UserError
from groundlink.inbox import Inbox
from groundlink.messages import Health
from groundlink.run_monitor import RunMonitor
from groundlink.scenario import Scenario, load
from groundlink.supervisor import Supervisor
from groundlink.topics import HEALTH, process_names

from .dashboard import dashboard

START_SECONDS = 20.0
"""After this long the duration counts even if a stream has not arrived."""

PLAIN_PERIOD_SECONDS = 5.0
"""Between tables where the output is no terminal."""

PLAIN_WIDTH = 110

ROS_SIDE = "ros"
"""Name of the process that receives on the ROS side."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("up", help="start everything a scenario needs, here")
    parser.add_argument("scenario", help="scenario file (YAML)")
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help="end by itself after S seconds of sim time, counted once every stream arrives",
    )
    parser.add_argument("--report", type=Path, metavar="FILE.json", help="write what happened")
    parser.add_argument("--run", help="name of the run (default: the scenario's)")
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        default=DEFAULT_ENDPOINT,
        help="where the run's router listens for its processes and for others (%(default)s)",
    )
    parser.add_argument(
        "--no-ros", action="store_true", help="start nothing on the ROS side; it runs elsewhere"
    )
    parser.set_defaults(command=up)


def up(options: argparse.Namespace) -> int:
    """Run a scenario until Ctrl-C or the duration's end; 0 when every declared rate was kept."""
    scenario = load(options.scenario)
    if options.duration is not None and not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    if options.report and not options.report.resolve().parent.is_dir():
        raise UserError(f"--report {options.report}: there is no folder {options.report.parent}")
    run = options.run or scenario.name
    stop = _stop_on_signals()
    console = Console() if sys.stdout.isatty() else Console(width=PLAIN_WIDTH)
    commands = _commands(scenario, options.scenario, run, options.listen)
    if not options.no_ros:
        commands[ROS_SIDE] = _ros_side(scenario, console)
    supervisor = Supervisor(
        commands, lambda name, line: console.print(f"{name}: {line}", markup=False, highlight=False)
    )
    monitor = RunMonitor()
    failed: str | None = None
    with Bus(listen=options.listen) as bus:
        inbox: Inbox[Health] = Inbox(depth=1024)
        bus.subscribe(HEALTH.key_in(run), Health, inbox)
        started = time.time()
        supervisor.start()
        try:
            show = _display(console, f"{scenario.name} (run `{run}`)", monitor, supervisor)
            failed = _watch(supervisor, monitor, inbox, options.duration, stop, show)
        finally:
            killed = supervisor.stop()
    if killed:
        console.print(f"killed, as they did not end in time: {', '.join(killed)}")
    if failed:
        print(f"groundlink: {failed} cannot run; see its line above", file=sys.stderr)
        return 2
    faults = monitor.faults() if monitor.streams or not options.no_ros else []
    _summarise(console, monitor, supervisor, faults)
    if options.report:
        report = _report(scenario, run, started, monitor, supervisor, faults)
        options.report.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    return 1 if faults else 0


def _watch(
    supervisor: Supervisor,
    monitor: RunMonitor,
    inbox: Inbox[Health],
    duration: float | None,
    stop: threading.Event,
    show: Callable[[bool], None],
) -> str | None:
    """Tend the run until it ends; return the process that its user must mend, if any."""
    begun = time.monotonic()
    counted_from: float | None = None
    with_duration = duration is not None
    while not stop.is_set():
        if failed := supervisor.tend():
            return failed
        while arrived := inbox.get(seconds=0.0 if len(inbox) else 0.05):
            monitor.heard(arrived[1], time.monotonic())
            if stop.is_set():
                break
        show(False)
        late = time.monotonic() - begun > START_SECONDS
        if counted_from is None and (monitor.everything_arrives() or late):
            counted_from = monitor.sim_seconds
        if with_duration and counted_from is not None:
            assert duration is not None
            if monitor.sim_seconds - counted_from >= duration:
                break
    show(True)
    return None


def _display(
    console: Console, title: str, monitor: RunMonitor, supervisor: Supervisor
) -> Callable[[bool], None]:
    """Return a function that shows the run now; its argument says whether it is the last time."""

    def picture() -> RenderableType:
        return dashboard(title, monitor, supervisor.children.values())

    if console.is_terminal:
        live = Live(console=console, get_renderable=picture, refresh_per_second=4, transient=True)
        live.start()
        return lambda last: live.stop() if last else None
    next_print = time.monotonic() + PLAIN_PERIOD_SECONDS

    def show(last: bool) -> None:
        nonlocal next_print
        if not last and time.monotonic() >= next_print:
            next_print += PLAIN_PERIOD_SECONDS
            console.print(picture())

    return show


def _commands(scenario: Scenario, file: str, run: str, endpoint: str) -> dict[str, list[str]]:
    """Return the command of every process of a run."""
    join = ["--connect", endpoint, "--run", run]
    commands = {}
    for name, module in process_names(scenario).items():
        arguments = [file] if name == "physics" else ["--name", name] if "/" in name else []
        commands[name] = ["-m", module, *arguments, *join]
    return commands


def _ros_side(scenario: Scenario, console: Console) -> list[str]:
    """Return the command that receives at the gateway's peer: the ROS 2 node where ROS is."""
    bind = ["--bind", scenario.gateway.peer]
    key = {"--key-file": scenario.gateway.key_file, "--key-env": scenario.gateway.key_env}
    bind += [word for name, value in key.items() if value is not None for word in (name, value)]
    if importlib.util.find_spec("rclpy") and importlib.util.find_spec("udp_bridge_ros2"):
        return ["-m", "udp_bridge_ros2", *bind]
    console.print("no ROS 2 in this environment: a plain receiver stands in for the ROS node")
    return ["-m", "udp_bridge", "listen", *bind, "--report", "--quiet"]


def _summarise(
    console: Console, monitor: RunMonitor, supervisor: Supervisor, faults: list[str]
) -> None:
    console.print(dashboard("summary", monitor, supervisor.children.values()))
    for fault in faults:
        console.print(f"not kept: {fault}")
    if not faults:
        console.print("every declared rate was kept within 2 %")


def _report(
    scenario: Scenario,
    run: str,
    started: float,
    monitor: RunMonitor,
    supervisor: Supervisor,
    faults: list[str],
) -> dict[str, object]:
    """Return what happened in a run, as plain data."""
    return {
        "groundlink": __version__,
        "run": run,
        "started": started,
        "sim_seconds": monitor.sim_seconds,
        "real_time_factor": monitor.real_time_factor,
        "faults": faults,
        "streams": [msgspec.to_builtins(stream) for stream in monitor.streams],
        "processes": {
            child.name: {
                "restarts": child.restarts,
                "last_exit": child.last_exit,
                "counters": health.counters if (health := monitor.health.get(child.name)) else {},
            }
            for child in supervisor.children.values()
        },
        "scenario": msgspec.to_builtins(scenario),
    }


def _stop_on_signals() -> threading.Event:
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    return stop
