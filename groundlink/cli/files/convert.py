# SPDX-License-Identifier: Apache-2.0
"""`groundlink convert RUN.mcap RUN.bag`: convert a recording to a ROS 1 bag."""

import argparse
from pathlib import Path

from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import tracked
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("convert", help="convert a recording to a ROS 1 bag")
    parser.add_argument("recording", metavar="RUN.mcap", help="recording to read")
    parser.add_argument("bag", metavar="RUN.bag", help="bag to write")
    add_json_option(parser)
    parser.set_defaults(command=convert)


def convert(options: argparse.Namespace) -> int:
    """Write the bag."""
    with needs("record"):
        from groundlink.recording.reader import Recording
        from groundlink.recording.ros1 import write_bag
        from groundlink.ros.types import register_unknown

    out = Path(options.bag)
    if out.suffix != ".bag":
        raise UserError(f"{out}: expected a file name that ends in .bag")
    check_new_file("RUN.bag:", out)
    with Recording(Path(options.recording)) as recording:
        register_unknown(recording.definitions)
        messages = tracked(recording.read(), f"writing {out.name}", recording.messages)
        with write_atomically(out) as part:
            count = write_bag(part, recording.types, messages)
    size = out.stat().st_size
    if options.json:
        print_json({"path": str(out), "messages": count, "bytes": size})
    else:
        print(f"wrote {out}: {count} messages, {size / 1e6:.1f} MB")
    return 0
