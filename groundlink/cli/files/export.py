# SPDX-License-Identifier: Apache-2.0
"""`groundlink export RUN.mcap --out FOLDER`: write a recording as files of other tools."""

import argparse
import importlib
from pathlib import Path

from rich.console import Console

from groundlink.cli import Subparsers
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import tracked
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import RequirementError, UserError
from groundlink.core.extras import needs
from groundlink.data.formats import FORMATS

EXTRA = "export"


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "export",
        help="write a recording as files of other tools",
        description="Write a recording as files of other tools. Without a format: all that fit.",
    )
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="recording to read")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER", help="new or empty folder to write"
    )
    for name, form in FORMATS.items():
        parser.add_argument(f"--{name}", dest=name, action="store_true", help=form.what)
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="TOPIC",
        help="export only this topic; may be repeated",
    )
    parser.add_argument(
        "--frame",
        action="append",
        default=[],
        metavar="FRAME",
        help="also the true poses of this frame, such as lidar_link (--tum, --kitti); may be "
        "repeated",
    )
    parser.add_argument(
        "--from", dest="start_s", type=float, metavar="S", help="sim time to begin with, in seconds"
    )
    parser.add_argument(
        "--to", dest="end_s", type=float, metavar="S", help="sim time to end before, in seconds"
    )
    add_json_option(parser)
    parser.set_defaults(command=export)


def export(options: argparse.Namespace) -> int:
    """Write the folder; print what it holds."""
    with needs(EXTRA):
        from groundlink.data.dataset import Dataset
        from groundlink.data.export import export as export_to

    out: Path = options.out
    _check_folder(out)
    console = terminal.console(stderr=options.json)
    formats = _formats(options, console)
    if options.frame and not {"tum", "kitti"} & set(formats):
        raise UserError("--frame: expected --tum or --kitti. Fix: add one of them")
    with Dataset(options.recording) as dataset, write_atomically(out) as part:
        part.mkdir()
        summary = export_to(
            dataset,
            part,
            formats=formats,
            topics=options.topic,
            frames=options.frame,
            start_s=options.start_s,
            end_s=options.end_s,
            watch=lambda messages, total: tracked(messages, f"writing {out.name}", total),
        )
        if not summary.paths:
            reasons = _by_reason(summary.left_out)
            raise UserError(f"{options.recording}: nothing to export: {'; '.join(reasons)}")
    if options.json:
        content = {"path": str(out), "files": summary.paths, "left_out": summary.left_out}
        print_json(content)
        return 0
    table = FittingTable(
        f"wrote {out}", (Column("file", "path"), Column("topic", "text"), Column("messages"))
    )
    for written in summary.paths:
        table.add_row(written.path, written.topic, str(written.messages))
    console.print(table)
    for line in _by_reason(summary.left_out):
        terminal.say(console, f"not exported: {line}")
    return 0


def _check_folder(out: Path) -> None:
    """Check that a folder is new or empty. Raises UserError."""
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        what = "folder is not empty" if out.is_dir() else "file exists"
        raise UserError(f"--out {out}: {what}. Fix: delete it or choose another name")
    if not out.resolve().parent.is_dir():
        raise UserError(f"--out {out}: no such folder: {out.parent}")


def _formats(options: argparse.Namespace, console: Console) -> list[str]:
    """Return the chosen formats; without a choice those whose packages are installed."""
    chosen = [name for name in FORMATS if getattr(options, name)]
    missing = []
    for name in chosen or FORMATS:
        if not FORMATS[name].module:
            continue
        try:
            with needs(EXTRA):
                importlib.import_module(FORMATS[name].module)
        except RequirementError as error:
            if chosen:
                raise
            missing.append(name)
            terminal.say(console, f"no --{name}: {error}")
    return chosen or [name for name in FORMATS if name not in missing]


def _by_reason(left_out: dict[str, str]) -> list[str]:
    """Return a line for each reason, with its topics."""
    return [
        f"{', '.join(topic for topic in left_out if left_out[topic] == reason)}: {reason}"
        for reason in dict.fromkeys(left_out.values())
    ]
