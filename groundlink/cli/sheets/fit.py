# SPDX-License-Identifier: Apache-2.0
"""`groundlink fit RECORDING --sheet SHEET --out SHEET.yaml`: fit a sheet's noise to a recording."""

import argparse
from pathlib import Path

from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader.datasheets import load_datasheet


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "fit", help="write a sensor's data sheet with the noise of a recording"
    )
    parser.add_argument(
        "recording",
        metavar="RECORDING",
        help="bag or MCAP file; LiDAR: clouds or packets, also .pcap or .osf; IMU at rest: "
        "sensor_msgs/Imu, also .csv; GNSS at rest: NavSatFix, also a log of NMEA or UBX",
    )
    parser.add_argument("--topic", metavar="TOPIC", help="topic, if several have such messages")
    parser.add_argument("--sheet", required=True, help="data sheet of the device: name or file")
    parser.add_argument("--out", required=True, metavar="SHEET.yaml", help="data sheet to write")
    parser.add_argument(
        "--source", metavar="TEXT", help="source of the recording, for the sheet; default: its name"
    )
    parser.add_argument(
        "--device", metavar="TEXT", help="device, if it is another one than that of the data sheet"
    )
    add_json_option(parser)
    parser.set_defaults(command=fit)


def fit(options: argparse.Namespace) -> int:
    """Write the sheet; print the residuals."""
    with needs("record"):
        from groundlink.fitting.fitters import FITTERS
        from groundlink.fitting.sheet_file import sheet_text

    out, recording = Path(options.out), Path(options.recording)
    check_new_file("--out", out)
    base = load_datasheet(options.sheet)
    if base.kind not in FITTERS:
        raise UserError(
            f"--sheet {options.sheet}: of kind `{base.kind}`; expected one of {', '.join(FITTERS)}"
        )
    with progress("fitting"):
        fitted = FITTERS[base.kind](recording, options.topic, base)
    text = sheet_text(base, options.source or recording.name, fitted, options.device)
    with write_atomically(out) as part:
        part.write_text(text)
    if options.json:
        print_json({"path": str(out), **fitted.document})
        return 0
    for line in fitted.printed:
        print(line)
    print(f"wrote {out}")
    return 0
