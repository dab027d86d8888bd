# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.recorder``: joins a run and writes it to a file."""

from __future__ import annotations

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
from groundlink.process.joining import join

with process_needs(NAME, "record"):
    from .mcap_files import McapFiles
    from .ordered_mcap_files import OrderedMcapFiles
    from .runner import record

JOURNAL_SECONDS = 0.5
"""How long physics may take to answer; who asks records nothing meanwhile."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Record until `stop` is set or the duration is over."""
    parser = process.parser(
        NAME, "Write every stream of a run to an MCAP file with ROS 2 messages."
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE.mcap", help="what to write"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="end after S s of sim time")
    parser.add_argument(
        "--ordered",
        action="store_true",
        help="write equal files of equal runs: in the order of log times and topics, without "
        "/diagnostics; for runs that do not follow the wall clock",
    )
    options = parser.parse_args(arguments)
    if options.duration is not None and not options.duration > 0:
        raise UserError(f"--duration {options.duration:g}: expected seconds, more than 0")
    duration = None if options.duration is None else round(options.duration * NANOS)
    with Bus(connect=process.endpoint(options), name=NAME) as bus:
        run, scenario = join(bus, options.run, stop)

        def journal(question: str) -> bytes:
            return b"".join(bus.query(journal_key(run), question, seconds=JOURNAL_SECONDS).values())

        keeper = OrderedMcapFiles if options.ordered else McapFiles
        files = keeper(options.out, scenario, run, journal)
        try:
            record(bus, scenario, run, files, duration, stop, ordered=options.ordered)
        except OSError as error:
            problem = f"cannot write {files.path}: {(error.strerror or str(error)).lower()}"
            if files.has_begun:
                raise RequirementError(f"{problem}; it ends with what was written before") from None
            raise UserError(problem) from None


if __name__ == "__main__":
    process.run(NAME, main)
