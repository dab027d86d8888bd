# SPDX-License-Identifier: Apache-2.0
"""`groundlink drive`: drive a vehicle by keyboard or joystick, or along a route by the driver.

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
from threading import Event

from groundlink.bus.core_topics import CLOCK, COMMAND
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import driver_name
from groundlink.cli import Subparsers
from groundlink.cli.terminal.joystick import ENABLE_BUTTON, Joystick
from groundlink.cli.terminal.keyboard import Keyboard
from groundlink.core.errors import UserError, did_you_mean
from groundlink.loader.scenario_files import load_route, read_route
from groundlink.messages.base import Clock, Command
from groundlink.monitor.process_commands import joining
from groundlink.process import runner as process
from groundlink.scenario import Scenario
from groundlink.scenario.route import FIGURES
from groundlink.scenario.schema import Vehicle

from .connection import joined

PERIOD_SECONDS = 0.05
"""Period of commands."""

TIME_SECONDS = 3.0
"""Timeout of the run's clock."""

JOYSTICK = "/dev/input/js0"
"""Default device."""

READ_BYTES = 4096
"""More than a person causes in a period."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "drive", help="drive a vehicle by keyboard or joystick, or along a route"
    )
    parser.add_argument(
        "vehicle", nargs="?", help="name of the vehicle; required if the run has several"
    )
    process.add_run_arguments(parser)
    way = parser.add_mutually_exclusive_group()
    way.add_argument(
        "--route",
        metavar="FILE.yaml|FIGURE",
        help="follow the route of a file, or a figure from the current pose: circle, "
        "figure_eight, square, there_and_back; ends with the route",
    )
    way.add_argument(
        "--joystick",
        nargs="?",
        const=JOYSTICK,
        metavar="DEVICE",
        help=f"drive by the left stick of a joystick or gamepad (default {JOYSTICK})",
    )
    parser.add_argument(
        "--enable-button",
        type=int,
        default=ENABLE_BUTTON,
        metavar="N",
        help="button of the joystick that is held to drive (%(default)s, a left shoulder button)",
    )
    parser.add_argument(
        "--speed", type=float, default=0.5, metavar="M/S", help="speed (%(default)s)"
    )
    parser.add_argument(
        "--turn-rate", type=float, default=0.8, metavar="RAD/S", help="turn rate (%(default)s)"
    )
    parser.set_defaults(command=drive)


def drive(options: argparse.Namespace) -> int:
    """Drive until `q` or Ctrl-C, or start the driver of a route in place of this process."""
    if not options.route and not options.joystick and not sys.stdin.isatty():
        raise UserError(
            "drive: driving by keyboard requires a terminal. Fix: pass --joystick or --route, or "
            "publish Twist on the vehicle's command topic"
        )
    for name in ("speed", "turn_rate"):
        if not getattr(options, name) > 0:
            raise UserError(f"--{name.replace('_', '-')}: expected a number above 0")
    if options.route and options.route not in FIGURES:
        read_route(options.route)
    stop = process.stop_on_signals()
    endpoint = process.endpoint(options)
    with joined(options, stop=stop) as (bus, run, scenario):
        vehicle = _vehicle(scenario, options.vehicle)
        if not options.route:
            limits = {
                "speed_mps": options.speed,
                "turn_radps": options.turn_rate,
                "max_mps": vehicle.model.top_speed_mps,
            }
            if options.joystick:
                stick = Joystick(**limits, enable_button=options.enable_button)
                with _joystick(options.joystick) as fd:
                    _drive_live(bus, run, vehicle, stick, fd, stop)
            else:
                with _raw_terminal() as fd:
                    _drive_live(bus, run, vehicle, Keyboard(**limits), fd, stop)
            return 0
    load_route(options.route, vehicle)  # report errors here, before the driver starts
    words = ["--name", driver_name(vehicle), "--route", options.route, "--once"]
    words += joining(run, endpoint)
    os.execv(sys.executable, [sys.executable, "-m", "services.driver", *words])


def _drive_live(
    bus: Bus, run: str, vehicle: Vehicle, device: Keyboard | Joystick, fd: int, stop: Event
) -> None:
    """Publish what a person commands by a device, until it or a signal ends that."""
    clocks: BusInbox[Clock] = BusInbox(depth=4)
    bus.subscribe(CLOCK.key_in(run), Clock, clocks)
    publish = bus.publisher(COMMAND.key_in(run, vehicle=vehicle.name), COMMAND.delivery)
    first = clocks.get(seconds=TIME_SECONDS)
    if first is None:
        raise UserError(
            f"run `{run}`: no clock within {TIME_SECONDS:g} s. Fix: check that physics is stepping"
        )
    stamp = first[1].stamp_nanos
    print(f"{vehicle.name} of run `{run}`: {device.help}")
    due_seconds = time.monotonic()
    try:
        while not stop.is_set():
            if select.select([fd], [], [], max(due_seconds - time.monotonic(), 0.0))[0]:
                data = _read(fd)
                if not data or not device.read(data, time.monotonic()):
                    break
            if time.monotonic() < due_seconds:
                continue  # a stick that moves causes hundreds of events a second
            due_seconds = time.monotonic() + PERIOD_SECONDS
            while len(clocks) and (clock := clocks.get(seconds=0)):
                stamp = clock[1].stamp_nanos
            speed, turn = device.twist(time.monotonic())
            publish(Command(stamp, (speed, 0.0, 0.0), (0.0, 0.0, turn)))
            _show(speed, turn, device)
    finally:
        publish(Command(stamp, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))


def _vehicle(scenario: Scenario, name: str | None) -> Vehicle:
    """Return the vehicle of that name, or the only one."""
    found = {vehicle.name: vehicle for vehicle in scenario.vehicles}
    if name is None and len(found) > 1:
        raise UserError(f"drive: expected the name of a vehicle, one of {', '.join(found)}")
    name = name or next(iter(found))
    if name not in found:
        raise UserError(f"the run has no vehicle `{name}`; {did_you_mean(name, found)}")
    return found[name]


def _read(fd: int) -> bytes:
    """Return the bytes that wait; none at their end.

    Raises
    ------
    UserError
        if the device was removed.
    """
    try:
        return os.read(fd, READ_BYTES)
    except OSError as error:
        raise UserError(f"drive: the joystick was removed ({error.strerror})") from None


@contextmanager
def _joystick(device: str) -> Iterator[int]:
    """Open a joystick.

    Raises
    ------
    UserError
        if that is not possible.
    """
    try:
        fd = os.open(device, os.O_RDONLY)
    except OSError as error:
        raise UserError(
            f"--joystick {device}: {(error.strerror or str(error)).lower()}. Fix: connect a "
            "joystick and name its device (`ls /dev/input/js*`); your user must be in the group "
            "`input`"
        ) from None
    try:
        yield fd
    finally:
        os.close(fd)
        print()


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


def _show(speed: float, turn: float, device: Keyboard | Joystick) -> None:
    limits = f"at most {device.speed_mps:.2f} m/s, {device.turn_radps:.2f} rad/s"
    line = f"\r{speed:+.2f} m/s {turn:+.2f} rad/s   {limits} "
    sys.stdout.write(line)
    sys.stdout.flush()
