# SPDX-License-Identifier: Apache-2.0
"""`groundlink verify RUN.mcap SCENARIO`: repeat a recorded run and compare byte for byte.

Starts physics with the journal of the recording, the recorded sensors, and a recorder that compares
instead of writing. Differences of the setup are printed before the run, of the messages after it.
With `--ros`, a scenario with a ROS stack is run twice instead (`verify_ros`).
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from rich.console import Console

from groundlink.cli import Subparsers
from groundlink.cli.run import running, supervised
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.episode import journal as journals
from groundlink.messages.base import Health
from groundlink.monitor import process_commands
from groundlink.scenario import Scenario

from .verify_ros import RosStack, verify_ros

if TYPE_CHECKING:
    from groundlink.recording.comparison import TopicComparison

FOLLOWED, VERDICT = "run.journal", "verdict.json"
"""Files exchanged with the started processes."""

SECONDS, LIMIT_SECONDS = 10.0, 60.0
"""Of a run with ROS, by default: sim time, and wall time for which that may stand still."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "verify",
        help="repeat a recorded run and compare byte for byte",
        usage="%(prog)s [-h] [--json] RUN.mcap SCENARIO\n"
        "       %(prog)s [--json] [--duration S] [--limit S] --ros SCENARIO -- COMMAND...",
    )
    recording = parser.add_argument(
        "recording", type=Path, metavar="RUN.mcap", help="recording to read"
    )
    scenario = parser.add_argument("scenario", help=running.SCENARIO_HELP)
    add_json_option(parser)
    parser.add_argument(
        "--duration",
        type=float,
        default=SECONDS,
        metavar="S",
        help="with --ros: sim time to compare (default %(default)g s)",
    )
    parser.add_argument(
        "--limit",
        type=float,
        default=LIMIT_SECONDS,
        metavar="S",
        help="with --ros: end a run whose sim time stands still for this wall time (default "
        "%(default)g s)",
    )
    parser.add_argument(
        "--ros",
        action=_RosScenario,
        positionals=(recording, scenario),
        metavar="SCENARIO",
        help="instead of repeating a recording, run this scenario in lockstep with ROS twice, each "
        "time with the ROS stack that a command starts: --ros SCENARIO -- COMMAND...",
    )
    parser.set_defaults(command=verify)


class _RosScenario(argparse.Action):
    """Option `--ros`: the positional arguments that follow are the words of a command."""

    def __init__(self, *, positionals: Sequence[argparse.Action], **settings: Any) -> None:
        super().__init__(**settings)
        self._positionals = positionals

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        setattr(namespace, self.dest, values)
        for positional in self._positionals:
            positional.nargs, positional.required, positional.type = "*", False, str


def verify(options: argparse.Namespace) -> int:
    """Repeat the run; return 0 if every comparable message is equal, else 1."""
    if options.ros is not None:
        for name in ("duration", "limit"):
            if not getattr(options, name) > 0:
                raise UserError(f"--{name} {getattr(options, name):g}: expected more than 0 s")
        stack = RosStack(options.ros, options.recording, options.duration, options.limit)
        return verify_ros(stack, as_json=options.json)
    with needs("record"):
        from groundlink.recording import missing_readings as missing
        from groundlink.recording import verifying
        from groundlink.recording.comparison import TopicComparison
        from groundlink.recording.reader import Recording

    console = terminal.console(stderr=options.json)

    def say(line: str) -> None:
        terminal.say(console, line)

    scenario = running.load_scenario(options.scenario)
    with Recording(options.recording) as recording, tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        extent = verifying.compared_span(recording)
        scenario = verifying.in_recorded_world(recording, scenario)
        for line in verifying.caveats(recording, scenario, extent):
            say(line)
        again = verifying.replay_journal(recording, scenario)
        journals.write(folder / FOLLOWED, journals.dumped(again))
        absent = verifying.silent_sensors(recording, scenario)
        epoch_nanos = recording.run.epoch_nanos
        seconds = (extent.end_nanos - epoch_nanos) / NANOS
        code = _run(console, options.recording, again.scenario, absent, folder, seconds)
        if code is not None:
            return code
        counting_on = missing.accumulating_topics(recording)
        verdicts = msgspec.json.decode((folder / VERDICT).read_bytes(), type=list[TopicComparison])
        not_compared = {
            topic: why
            for topic, why in verifying.not_compared(recording).items()
            if recording.topics[topic].messages
        }
    if options.json:
        may_differ = {v.topic: counting_on[v.topic] for v in verdicts if v.topic in counting_on}
        is_identical = all(v.is_equal or v.topic in may_differ for v in verdicts)
        print_json(
            {
                "identical": is_identical,
                "topics": verdicts,
                "may_differ": may_differ,
                "not_compared": not_compared,
            }
        )
        return 0 if is_identical else 1
    console.print(_table(verdicts, epoch_nanos))
    for why in dict.fromkeys(not_compared.values()):
        say(f"not compared: {', '.join(t for t in not_compared if not_compared[t] == why)}: {why}")
    for line in _left_out(verdicts):
        say(line)
    different = sorted(
        ((found.nanos, v) for v in verdicts if (found := v.first)), key=lambda pair: pair[0]
    )
    for _, one in different:
        if one.topic in counting_on:
            say(f"may differ: {_first(one, epoch_nanos)}; {counting_on[one.topic]}")
    different = [(nanos, one) for nanos, one in different if one.topic not in counting_on]
    for number, (_, one) in enumerate(different):
        say(("and: " if number else "first difference: ") + _first(one, epoch_nanos))
    if different:
        return 1
    equal = [v for v in verdicts if v.is_equal]
    say(f"identical: {sum(v.equal for v in equal)} messages of {len(equal)} topics")
    return 0


def _run(
    console: Console,
    recording: Path,
    again: Scenario,
    absent: Collection[str],
    folder: Path,
    seconds: float,
) -> int | None:
    """Run until the recording is repeated; return an exit code if that failed."""
    verdict = folder / VERDICT
    run, endpoint = f"verify_{os.getpid()}", process_commands.free_endpoint()
    verifier = ["-m", "services.recorder.verifier", str(recording), "--verdict", str(verdict)]
    commands = process_commands.following(
        *(again, folder / FOLLOWED, verifier, run, endpoint),
        sensors=set(again.sensor_names()) - set(absent),
    )
    supervised_run = supervised.SupervisedRun(
        commands, run, endpoint, console, finite={running.RECORDER}
    )
    recorder, monitor = supervised_run.children[running.RECORDER], supervised_run.monitor

    def done(health: Health) -> tuple[float, str]:
        return min(health.tick * TICK_NANOS / NANOS, seconds), ""

    progress = supervised.RecorderProgress(monitor, seconds, done)
    failed = supervised_run.go(lambda: recorder.is_done, lambda: progress)
    if failed:
        return supervised.exit_code(failed)
    if not verdict.exists():
        console.print("ended early: nothing was compared")
        return 1
    return None


def _table(verdicts: list[TopicComparison], epoch_nanos: int) -> FittingTable:
    counted = ("recorded", "equal", "different", "missing", "new", "first at")
    columns = (Column("topic", "path"), *map(Column, counted))
    table = FittingTable("recording and repeated run", columns)
    for v in verdicts:
        counts = (v.recorded, v.equal, v.different, v.missing, v.new)
        first = "-" if v.first is None else f"{(v.first.nanos - epoch_nanos) / NANOS:.6f} s"
        table.add_row(v.topic, *map(str, counts), first)
    return table


def _left_out(verdicts: list[TopicComparison]) -> Iterator[str]:
    """Yield messages of the repeated run that cannot be in the recording."""
    for v in verdicts:
        for cause, count in v.left_out.items():
            yield f"not recorded: {v.topic}: {count} messages, {cause}"
        if v.ragged:
            yield f"cut by the start or end of the recording: {v.topic}: {v.ragged} messages"


def _first(verdict: TopicComparison, epoch_nanos: int) -> str:
    """Return the first difference of a topic: topic, time, field."""
    found = verdict.first
    assert found
    stamp = f"{found.nanos // NANOS}.{found.nanos % NANOS:09d}"
    place = f" at {(found.nanos - epoch_nanos) / NANOS:.6f} s (stamp {stamp})"
    place += f", message {found.number} of {verdict.recorded}"
    return f"{verdict.topic}{place if found.number else ''}: {found.words}"
