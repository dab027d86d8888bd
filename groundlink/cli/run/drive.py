# SPDX-License-Identifier: Apache-2.0
"""`groundlink drive`: drive a vehicle by keyboard, or along a route by the driver process.

Publishes velocities like a ROS node; of several sources the newest command applies. The terminal is
always restored.
"""

import argparse
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from groundlink.bus.core_topics import CLOCK, COMMAND
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import driver_name
from groundlink.cli import Subparsers
from groundlink.cli.terminal.keyboard import HELP, Keyboard, keys
from groundlink.cli.terminal.output import stop_on_signals
from groundlink.core.errors import UserError, did_you_mean
from groundlink.loader.scenario_files import load_route, read_route
from groundlink.messages.base import Clock, Command
from groundlink.monitor.process_commands import joining
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.scenario import Scenario
from groundlink.scenario.route import FIGURES
from groundlink.scenario.schema import Vehicle

PERIOD_SECONDS = 0.05
"""Period of commands."""

TIME_SECONDS = 3.0
"""Timeout of the run's clock."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("drive", help="drive a vehicle by keyboard or along a route")
    parser.add_argument(
        "vehicle", nargs="?", help="name of the vehicle; required if the run has several"
    )
    process.add_run_arguments(parser)
    parser.add_argument(
        "--route",
        metavar="FILE.yaml|FIGURE",
        help="follow the route of a file, or a figure from the current pose: circle, "
        "figure_eight, square, there_and_back; ends with the route",
    )
    parser.set_defaults(command=drive)


def drive(options: argparse.Namespace) -> int:
    """Drive until `q` or Ctrl-C, or start the driver of a route in place of this process."""
    if not options.route and not sys.stdin.isatty():
        raise UserError(
            "drive: driving by keyboard requires a terminal. Fix: pass --route, or publish Twist "
            "on the vehicle's command topic"
        )
    if options.route and options.route not in FIGURES:
        read_route(options.route)
    stop = stop_on_signals()
    endpoint = process.endpoint(options)
    with Bus(connect=endpoint) as bus:
        run, scenario = join(bus, options.run, stop)
        vehicle = _vehicle(scenario, options.vehicle)
        if not options.route:
            clocks: BusInbox[Clock] = BusInbox(depth=4)
            bus.subscribe(CLOCK.key_in(run), Clock, clocks)
            publish = bus.publisher(COMMAND.key_in(run, vehicle=vehicle.name), COMMAND.delivery)
            first = clocks.get(seconds=TIME_SECONDS)
            if first is None:
                raise UserError(
                    f"run `{run}`: no clock within {TIME_SECONDS:g} s. Fix: check that physics is "
                    "stepping"
                )
            stamp = first[1].stamp_nanos
            board = Keyboard(max_mps=vehicle.model.top_speed_mps)
            print(f"{vehicle.name} of run `{run}`: {HELP}")
            with _raw_terminal() as fd:
                while not stop.is_set():
                    if select.select([fd], [], [], PERIOD_SECONDS)[0]:
                        pressed = list(keys(os.read(fd, 64)))
                        if "q" in pressed:
                            break
                        for key in pressed:
                            board.pressed(key, time.monotonic())
                    while len(clocks) and (clock := clocks.get(seconds=0)):
                        stamp = clock[1].stamp_nanos
                    speed, turn = board.twist(time.monotonic())
                    publish(Command(stamp, (speed, 0.0, 0.0), (0.0, 0.0, turn)))
                    _show(speed, turn, board)
            publish(Command(stamp, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
            return 0
    load_route(options.route, vehicle)  # report errors here, before the driver starts
    words = ["--name", driver_name(vehicle), "--route", options.route, "--once"]
    words += joining(run, endpoint)
    os.execv(sys.executable, [sys.executable, "-m", "services.driver", *words])


def _vehicle(scenario: Scenario, name: str | None) -> Vehicle:
    """Return the vehicle of that name, or the only one."""
    found = {vehicle.name: vehicle for vehicle in scenario.vehicles}
    if name is None and len(found) > 1:
        raise UserError(f"drive: expected the name of a vehicle, one of {', '.join(found)}")
    name = name or next(iter(found))
    if name not in found:
        raise UserError(f"the run has no vehicle `{name}`; {did_you_mean(name, found)}")
    return found[name]


@contextmanager
def _raw_terminal() -> Iterator[int]:
    """Read single keys without echo; restore the terminal afterwards."""
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    try:
        tty.setcbreak(fd)
        yield fd
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)
        print()


def _show(speed: float, turn: float, board: Keyboard) -> None:
    limits = f"keys set {board.speed_mps:.2f} m/s, {board.turn_radps:.2f} rad/s"
    line = f"\r{speed:+.2f} m/s {turn:+.2f} rad/s   {limits} "
    sys.stdout.write(line)
    sys.stdout.flush()
