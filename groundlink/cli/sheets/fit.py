# SPDX-License-Identifier: Apache-2.0
"""`groundlink fit RECORDING --sheet SHEET --out SHEET.yaml`: fit a LiDAR's noise to a recording."""

import argparse
from pathlib import Path

import numpy as np

from groundlink.cli import Subparsers
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader.datasheets import load_datasheet

KINDS = ("lidar", "lidar_2d")


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "fit", help="write a LiDAR's data sheet with the noise and dropout of a recording"
    )
    parser.add_argument(
        "recording",
        metavar="RECORDING",
        help="bag or MCAP file with clouds or packets, .pcap of packets, or .osf",
    )
    parser.add_argument(
        "--topic", metavar="TOPIC", help="topic of clouds or packets, if there are several"
    )
    parser.add_argument("--sheet", required=True, help="data sheet of the device: name or file")
    parser.add_argument("--out", required=True, metavar="SHEET.yaml", help="data sheet to write")
    parser.add_argument(
        "--source", metavar="TEXT", help="source of the recording, for the sheet; default: its name"
    )
    add_json_option(parser)
    parser.set_defaults(command=fit)


def fit(options: argparse.Namespace) -> int:
    """Write the sheet; print the noise by intensity and range."""
    with needs("record"):
        from groundlink.fitting import fitted_sheet
        from groundlink.fitting.recordings import read_firings

    out, recording = Path(options.out), Path(options.recording)
    check_new_file("--out", out)
    base = load_datasheet(options.sheet)
    if base.kind not in KINDS:
        raise UserError(f"--sheet {options.sheet}: of kind `{base.kind}`; expected a LiDAR's")
    found = fitted_sheet.fit(read_firings(recording, options.topic), str(recording))
    text = fitted_sheet.sheet_text(
        {"kind": base.kind, "datasheet": base.title, **base.figures},
        *(base.name, options.source or recording.name, found),
    )
    with write_atomically(out) as part:
        part.write_text(text)
    if options.json:
        table = fitted_sheet.echo_bands(found)
        print_json({"path": str(out), "windows": len(found.windows.laser), "echo_bands": table})
        return 0
    noise = found.noise
    print("Noise in millimeters, 1 sigma, by intensity and range:")
    print(f"{'':>9}" + "".join(f"{place:>8.1f} m" for place in noise.range_m))
    for intensity, row in zip(noise.intensity, noise.value, strict=True):
        cells = (f"{1e3 * sigma:10.1f}" if np.isfinite(sigma) else f"{'-':>10}" for sigma in row)
        print(f"{intensity:9.1f}" + "".join(cells))
    print(f"wrote {out}: {len(found.windows.laser)} windows of smooth surfaces")
    return 0
