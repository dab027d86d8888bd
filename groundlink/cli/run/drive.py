# SPDX-License-Identifier: Apache-2.0
"""`groundlink drive`: a vehicle of a run by keyboard, or along a route by the driver process.

Rule: says what any ROS node could say, a velocity; of two that speak at once, the newest counts.
The terminal is restored whatever happens.
"""

from __future__ import annotations

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
from groundlink.cli.terminal.keyboard import HELP, Keyboard, keys
from groundlink.cli.terminal.output import stop_on_signals
from groundlink.core.errors import UserError, did_you_mean
from groundlink.loader.scenario_files import load_route, read_route
from groundlink.messages.base import Clock, Command
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.scenario import Scenario
from groundlink.scenario.route import FIGURES
from groundlink.scenario.schema import Vehicle

from .running import joining

PERIOD_SECONDS = 0.05
"""Between two commands."""

TIME_SECONDS = 3.0
"""How long the run may take to say what time it is."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("drive", help="drive a vehicle by keyboard or along a route")
    parser.add_argument("vehicle", nargs="?", help="its name; needed only where there are several")
    parser.add_argument("--connect", metavar="ENDPOINT", help="router of the run")
    parser.add_argument("--run", help="name of the run; needed only where several run")
    parser.add_argument(
        "--route",
        metavar="FILE.yaml|FIGURE",
        help="no keyboard: follow waypoints or a figure of a file, or circle, figure_eight, "
        "square, there_and_back from where the vehicle stands; ends when it is driven",
    )
    parser.set_defaults(command=drive)


def drive(options: argparse.Namespace) -> int:
    """Drive until `q` or Ctrl-C, or become the driver of a route."""
    if not options.route and not sys.stdin.isatty():
        raise UserError(
            "driving by keyboard needs a terminal; give --route to drive without hands, or "
            "publish Twist on the vehicle's command topic"
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
                raise UserError(f"run `{run}` says no time; is its physics stepping?")
            stamp = first[1].stamp_nanos
            board = Keyboard(most_mps=vehicle.model.top_speed_mps)
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
    load_route(options.route, vehicle)  # a mistake in it is this command's to tell
    words = ["--name", driver_name(vehicle), "--route", options.route, "--once"]
    words += joining(run, endpoint)
    os.execv(sys.executable, [sys.executable, "-m", "services.driver", *words])


def _vehicle(scenario: Scenario, name: str | None) -> Vehicle:
    """Return the vehicle that is meant."""
    found = {vehicle.name: vehicle for vehicle in scenario.vehicles}
    if name is None and len(found) > 1:
        raise UserError(f"which vehicle? the run has {', '.join(found)}")
    name = name or next(iter(found))
    if name not in found:
        raise UserError(f"the run has no vehicle `{name}`; {did_you_mean(name, found)}")
    return found[name]


@contextmanager
def _raw_terminal() -> Iterator[int]:
    """Have keys come one by one and unseen; afterwards all is as before."""
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    try:
        tty.setcbreak(fd)
        yield fd
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)
        print()


def _show(speed: float, turn: float, board: Keyboard) -> None:
    limits = f"keys ask for {board.speed_mps:.2f} m/s, {board.turn_radps:.2f} rad/s"
    line = f"\r{speed:+.2f} m/s {turn:+.2f} rad/s   {limits} "
    sys.stdout.write(line)
    sys.stdout.flush()
