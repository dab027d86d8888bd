# SPDX-License-Identifier: Apache-2.0
"""`groundlink judge RUN.mcap [SCENARIO]`: judge a recorded run by expectations."""

import argparse
from pathlib import Path

from groundlink.cli import Subparsers
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.expectations.results import problems
from groundlink.loader.scenario_files import with_expectations

from .output import add_junit_option, check_junit, expectations_table, summary, write_junit


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("judge", help="judge a recorded run by expectations")
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="recording to read")
    parser.add_argument(
        "scenario",
        nargs="?",
        help="scenario, or a file with `expect` alone, whose expectations replace those of the "
        "recorded scenario",
    )
    add_json_option(parser)
    add_junit_option(parser)
    parser.set_defaults(command=judge)


def judge(options: argparse.Namespace) -> int:
    """Print the verdicts; return 0 if every expectation passed, else 1."""
    with needs("record"):
        from groundlink.recording.judging import judged
        from groundlink.recording.reader import Recording

    check_junit(options)
    with Recording(options.recording) as recording:
        scenario = recording.run.scenario
        if options.scenario:
            scenario = with_expectations(scenario, options.scenario)
        if not scenario.expect:
            raise UserError(
                f"{options.scenario or options.recording}: no expectations. Fix: pass a file with "
                "`expect`"
            )
        with progress(f"reading {options.recording.name}") as done:
            results = judged(recording, scenario, done)
    write_junit(options, scenario.name, results)
    faults = problems(results)
    if options.json:
        plain = [result.to_builtins() for result in results]
        print_json({"path": str(options.recording), "expectations": plain, "faults": faults})
    else:
        console = terminal.console()
        console.print(expectations_table(results))
        terminal.say(console, summary(results))
    return 1 if faults else 0
