# SPDX-License-Identifier: Apache-2.0
"""`groundlink verify RUN.mcap SCENARIO`: repeat a recorded run and compare byte for byte.

Starts physics with the journal of the recording, the recorded sensors, and a recorder that compares
instead of writing. Differences of the setup are printed before the run, of the messages after it.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from rich.console import Console

from groundlink.bus.topics import process_names
from groundlink.cli import Subparsers
from groundlink.cli.run import running, supervised
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.extras import needs
from groundlink.episode import journal as journals
from groundlink.messages.base import Health
from groundlink.monitor import process_commands
from groundlink.scenario import Scenario

if TYPE_CHECKING:
    from groundlink.recording.comparison import TopicComparison

FOLLOWED, VERDICT = "run.journal", "verdict.json"
"""Files exchanged with the started processes."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("verify", help="repeat a recorded run and compare byte for byte")
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="recording to read")
    parser.add_argument("scenario", help=running.SCENARIO_HELP)
    add_json_option(parser)
    parser.set_defaults(command=verify)


def verify(options: argparse.Namespace) -> int:
    """Repeat the run; return 0 if every comparable message is equal, else 1."""
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
    joining = process_commands.joining(run, endpoint)
    modules = process_names(again)
    commands = {
        "physics": ["-m", modules["physics"], "--follow", str(folder / FOLLOWED), *joining],
        running.RECORDER: [
            *(
                "-m",
                "services.recorder.verifier",
                str(recording),
                "--verdict",
                str(verdict),
                *joining,
            )
        ],
    }
    commands["physics"] += ["--wait-for", running.RECORDER]
    for name in again.sensor_names():
        if name not in absent:
            commands[name] = ["-m", modules[name], "--name", name, *joining]
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
