# SPDX-License-Identifier: Apache-2.0
"""`groundlink resim RUN.mcap SCENARIO --out OTHER.mcap`: a recorded drive with other sensors.

Starts physics with the journal of the recording, the sensors that differ from the recorded ones,
and a recorder. Their readings take the place of the recorded ones; all else is copied.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from groundlink.bus.topics import driver_names
from groundlink.cli import Subparsers
from groundlink.cli.run import running, supervised
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.clock import NANOS
from groundlink.core.extras import needs
from groundlink.episode import journal as journals
from groundlink.loader import overrides
from groundlink.messages.base import Health
from groundlink.monitor import process_commands

if TYPE_CHECKING:
    from groundlink.recording.reader import Recording
    from groundlink.scenario import Scenario

FOLLOWED, READINGS = "run.journal", "readings.mcap"
"""Files exchanged with the started processes."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "resim", help="simulate the sensors of a recorded run again, with changes"
    )
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="recording to read")
    parser.add_argument("scenario", help=running.SCENARIO_HELP)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="OTHER.mcap", help="file to write"
    )
    overrides.add_argument(parser)
    parser.set_defaults(command=resim)


def resim(options: argparse.Namespace) -> int:
    """Write the recording as it is with the scenario's sensors, weather and light."""
    with needs("record"):
        from groundlink.recording import resimulation, verifying
        from groundlink.recording.reader import Recording

    console = terminal.console()
    check_new_file("--out", options.out)
    changes = overrides.field_changes(options.set)
    scenario = running.load_scenario(options.scenario, changes)
    with Recording(options.recording) as recording, tempfile.TemporaryDirectory() as temporary:
        scenario = verifying.in_recorded_world(recording, scenario)
        resimulation.check_drive(recording.started_as, scenario)
        simulated = resimulation.sensors_to_simulate(recording.started_as, scenario)
        removed = set(recording.started_as.sensor_names()) - set(scenario.sensor_names())
        if not simulated and not removed:
            with write_atomically(options.out) as part:
                shutil.copyfile(options.recording, part)
            terminal.say(console, f"nothing differs: {options.out} is a copy")
            return 0
        again = Path(temporary) / READINGS if simulated else None
        if again is not None:
            code = _simulate(console, recording, scenario, simulated, again)
            if code is not None:
                return code
        with (
            progress(f"writing {options.out}"),
            Recording(again) if again else nullcontext() as readings,
            write_atomically(options.out) as part,
        ):
            copied, new = resimulation.write_resimulated(recording, readings, scenario, part)
    terminal.say(
        console,
        f"wrote {options.out}: {new} messages simulated ({', '.join(simulated) or 'no sensor'}), "
        f"{copied} copied",
    )
    return 0


def _simulate(
    console: Console, recording: Recording, scenario: Scenario, sensors: list[str], out: Path
) -> int | None:
    """Record the readings of some sensors on the recorded drive; return the code of a failure."""
    from groundlink.recording.verifying import compared_span, replay_journal

    journal = out.with_name(FOLLOWED)
    again = replay_journal(recording, scenario)
    journals.write(journal, journals.dumped(again))
    seconds = (compared_span(recording).end_nanos - recording.run.epoch_nanos) / NANOS
    absent = {*again.scenario.sensor_names(), *driver_names(again.scenario)} - {*sensors}
    recorder = ["-m", "services.recorder", "--out", str(out), "--ordered"]
    recorder += ["--duration", f"{seconds:.9f}"]
    recorder += [word for name in sorted(absent) for word in ("--absent", name)]
    run, endpoint = f"resim_{os.getpid()}", process_commands.free_endpoint()
    commands = process_commands.following(
        again.scenario, journal, recorder, run, endpoint, sensors=sensors
    )
    supervised_run = supervised.SupervisedRun(
        commands, run, endpoint, console, finite={running.RECORDER}
    )
    child, monitor = supervised_run.children[running.RECORDER], supervised_run.monitor

    def done(_: Health) -> tuple[float, str]:
        return min(monitor.sim_seconds, seconds), ""

    shown = supervised.RecorderProgress(monitor, seconds, done)
    failed = supervised_run.go(lambda: child.is_done, lambda: shown)
    if failed:
        return supervised.exit_code(failed)
    if not out.exists():
        console.print("ended early: nothing was simulated")
        return 1
    return None
