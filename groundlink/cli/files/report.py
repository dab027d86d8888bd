# SPDX-License-Identifier: Apache-2.0
"""`groundlink report RUN.mcap`: write a report of a recorded run as one HTML page."""

import argparse
from pathlib import Path

from groundlink.cli import Subparsers
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import write_atomically
from groundlink.core.extras import needs


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("report", help="write an HTML report of a recorded run")
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="recording to read")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="REPORT.html",
        help="page to write (default: beside the recording)",
    )
    parser.set_defaults(command=report)


def report(options: argparse.Namespace) -> int:
    """Write the page."""
    with needs("report"):
        from groundlink.recording.reader import Recording
        from groundlink.report.analysis.gather import gather
        from groundlink.report.page.page import page

    out = options.out or options.recording.with_suffix(".html")
    with Recording(options.recording) as recording:
        with progress(f"reading {options.recording.name}") as done:
            run = gather(recording, done)
        with progress("drawing the page"):
            content = page(run)
    with write_atomically(out) as part:
        part.write_text(content, encoding="utf-8")
    print(f"wrote {out}: {len(content) / 1e6:.1f} MB")
    return 0
