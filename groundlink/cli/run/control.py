# SPDX-License-Identifier: Apache-2.0
"""`groundlink pause`, `resume`, `step`, `reset`: a run under way does what a person says.

Rule: one table of commands; what each does is physics' business, whose answer is told.
"""

from __future__ import annotations

import argparse
import sys
import threading
import time

from groundlink.bus.control_client import run_status, send_command
from groundlink.bus.core_topics import HEALTH, PHYSICS
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.messages.base import Health
from groundlink.messages.control import AnyRunCommand, ControlAnswer, Pause, Reset, Resume, Step
from groundlink.messages.stalls import Stalls
from groundlink.process import runner as process
from groundlink.process.joining import join

POLL_SECONDS = 0.05
"""How often a run is asked whether its steps are done."""

WISHES: dict[str, tuple[type[AnyRunCommand], str]] = {
    "pause": (Pause, "let the sim time of a run stand still"),
    "resume": (Resume, "let the sim time of a run go on"),
    "step": (Step, "let sim time stand still again after some ticks of 2.5 ms"),
    "reset": (Reset, "begin a run again, everything at its start"),
}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to the command line."""
    for name, (wish, help_text) in WISHES.items():
        parser = subparsers.add_parser(name, help=help_text)
        if wish is Step:
            parser.add_argument("ticks", nargs="?", type=int, default=1, help="how many (1)")
        parser.add_argument("--run", help="name of the run; needed only where several run")
        parser.add_argument("--connect", metavar="ENDPOINT", help="router of the run")
        parser.set_defaults(command=control, wish=wish)


def control(options: argparse.Namespace) -> int:
    """Ask a run's physics to do a wish, and tell what became of it."""
    if options.wish is Step and options.ticks < 1:
        raise UserError(f"{options.ticks} ticks: expected 1 or more")
    wish = Step(options.ticks) if options.wish is Step else options.wish()
    with Bus(connect=process.endpoint(options)) as bus:
        run, _ = join(bus, options.run, threading.Event())
        waits = Waits(bus, run)
        answer = send_command(bus, run, wish)
        while isinstance(wish, Step) and not answer.paused:
            time.sleep(POLL_SECONDS)
            answer = run_status(bus, run)
            if line := waits.line(answer.tick):
                print(line, file=sys.stderr)
    print(told(run, answer))
    return 0


class Waits:
    """Says whom physics waits for, while steps are not done: what its counters say, once each."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._run = run
        self._health: BusInbox[Health] = BusInbox(depth=16)
        self._said: tuple[str, ...] = ()
        bus.subscribe(HEALTH.key_in(run, process=PHYSICS), Health, self._health)

    def line(self, tick: int) -> str:
        """Return a line where others are waited for than was said; empty otherwise."""
        silent = self._said
        while len(self._health) and (arrived := self._health.get(seconds=0)):
            silent = Stalls.read(arrived[1].counters).silent_now
        if silent == self._said:
            return ""
        self._said = silent
        names = ", ".join(silent)
        return f"run `{self._run}` waits at tick {tick} for {names}" if silent else ""


def told(run: str, answer: ControlAnswer) -> str:
    """Return a line on how a run is."""
    state = "paused" if answer.paused else "running"
    return f"run `{run}` is {state} at tick {answer.tick} ({answer.tick * TICK_SECONDS:.4f} s)"
