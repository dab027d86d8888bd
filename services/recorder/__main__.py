# SPDX-License-Identifier: Apache-2.0
"""Recorder process, started with ``python -m services.recorder``: writes a run to a file."""

import threading
from collections.abc import Sequence
from pathlib import Path

from groundlink.bus.core_topics import RECORDER as NAME
from groundlink.bus.queries import journal_key
from groundlink.bus.session import Bus
from groundlink.core.clock import NANOS
from groundlink.core.errors import RequirementError, UserError
from groundlink.core.extras import process_needs
from groundlink.process import runner as process
from groundlink.process.joining import join, report_missing_kinds

with process_needs(NAME, "record"):
    from .mcap_files import McapFiles
    from .ordered_mcap_files import OrderedMcapFiles
    from .runner import BusRecorder

JOURNAL_SECONDS = 0.5
"""Timeout for the journal; nothing is recorded while the recorder waits for it."""

ORDERED_JOURNAL_SECONDS = 30.0
"""The same for an ordered recording: the run waits for the recorder meanwhile."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Record until `stop` is set or the duration is over."""
    parser = process.parser(NAME, "Write all streams of a run to an MCAP file with ROS 2 messages.")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.mcap", help="the file to write"
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="stop after S seconds of simulation time"
    )
    parser.add_argument(
        "--ordered",
        action="store_true",
        help="write identical files for identical runs: sorted by log time and topic, without "
        "/diagnostics; for runs that do not follow the wall clock",
    )
    options = parser.parse_args(arguments)
    if options.duration is not None and not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    duration = None if options.duration is None else round(options.duration * NANOS)
    with Bus(connect=process.endpoint(options), name=NAME) as bus:
        run, scenario = join(bus, options.run, stop)
        report_missing_kinds("recorder", scenario)

        seconds = ORDERED_JOURNAL_SECONDS if options.ordered else JOURNAL_SECONDS

        def journal(part: str) -> bytes:
            return b"".join(bus.query(journal_key(run), part, seconds=seconds).values())

        files_type = OrderedMcapFiles if options.ordered else McapFiles
        files = files_type(options.out, scenario, run, journal)
        try:
            recorder = BusRecorder(*(bus, scenario, run, files, duration), ordered=options.ordered)
            recorder.record(stop)
        except OSError as error:
            problem = f"cannot write {files.path}: {(error.strerror or str(error)).lower()}"
            if files.has_begun:
                raise RequirementError(
                    f"{problem}; the file ends with the last messages written"
                ) from None
            raise UserError(problem) from None


if __name__ == "__main__":
    process.run(NAME, main)
