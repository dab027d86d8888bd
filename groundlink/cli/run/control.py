# SPDX-License-Identifier: Apache-2.0
"""`groundlink pause`, `resume`, `step`, `reset`: send a run command and print the answer."""

import argparse
import sys
import time

from groundlink.bus.control_client import POLL_SECONDS, run_status, send_command
from groundlink.bus.core_topics import HEALTH, PHYSICS
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.errors import UserError
from groundlink.episode.control import AnyRunCommand, ControlAnswer, Pause, Reset, Resume, Step
from groundlink.messages.base import Health
from groundlink.messages.stalls import Stalls
from groundlink.process import runner as process

from .connection import at_tick, joined, tick_text

COMMANDS: dict[str, tuple[type[AnyRunCommand], str]] = {
    "pause": (Pause, "pause the sim time of a run"),
    "resume": (Resume, "resume the sim time of a run"),
    "step": (Step, "advance a run by some ticks of 2.5 ms, then pause"),
    "reset": (Reset, "restart a run from its initial state"),
}


def add_parser(subparsers: Subparsers) -> None:
    """Add the commands to the command line."""
    for name, (run_command, help_text) in COMMANDS.items():
        parser = subparsers.add_parser(name, help=help_text)
        if run_command is Step:
            parser.add_argument(
                "ticks", nargs="?", type=int, default=1, help="number of ticks (%(default)s)"
            )
        process.add_run_arguments(parser)
        add_json_option(parser)
        parser.set_defaults(command=control, run_command=run_command)


def control(options: argparse.Namespace) -> int:
    """Send the command; wait until steps are done; print the state of the run."""
    if options.run_command is Step and options.ticks < 1:
        raise UserError(f"step: expected 1 or more ticks, got {options.ticks}")
    command = options.run_command
    command = Step(options.ticks) if command is Step else command()
    with joined(options) as (bus, run, _):
        stalls = StallReporter(bus, run)
        answer = send_command(bus, run, command)
        if isinstance(command, Step):
            answer = _stepped(bus, run, answer, command.ticks, stalls)
    print_status(run, answer, as_json=options.json)
    return 0


def _stepped(
    bus: Bus, run: str, answer: ControlAnswer, ticks: int, stalls: "StallReporter"
) -> ControlAnswer:
    """Return the state of the run when the steps after `answer` are done."""
    end = answer.tick + ticks
    with progress(f"run `{run}`: {ticks} ticks") as done:
        while not answer.paused:
            time.sleep(POLL_SECONDS)
            answer = run_status(bus, run)
            done(1 - (end - answer.tick) / ticks)
            if line := stalls.line(answer.tick):
                print(line, file=sys.stderr)
    return answer


class StallReporter:
    """Reports the processes that physics waits for, once for each change."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._run = run
        self._health: BusInbox[Health] = BusInbox(depth=16)
        self._reported: tuple[str, ...] = ()
        bus.subscribe(HEALTH.key_in(run, process=PHYSICS), Health, self._health)

    def line(self, tick: int) -> str:
        """Return a line if the processes that physics waits for changed, else an empty one."""
        silent = self._reported
        while len(self._health) and (arrived := self._health.get(seconds=0)):
            silent = Stalls.read(arrived[1].counters).silent_now
        if silent == self._reported:
            return ""
        self._reported = silent
        names = ", ".join(silent)
        return f"run `{self._run}`: waiting at tick {tick} for {names}" if silent else ""


def print_status(run: str, answer: ControlAnswer, *, as_json: bool) -> None:
    """Print the state of a run."""
    if as_json:
        print_json(at_tick(run, answer.tick, paused=answer.paused))
    else:
        state = "paused" if answer.paused else "running"
        print(f"run `{run}` is {state} at {tick_text(answer.tick)}")
