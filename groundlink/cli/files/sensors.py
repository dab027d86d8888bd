# SPDX-License-Identifier: Apache-2.0
"""`groundlink sensors [show NAME]`: list kinds of sensors and data sheets, or print a data sheet.

Rule: everything is taken from where it is used: kinds from the table of topics and the classes of
their fields, sheets from their files. A sheet is shown as it is written, since its comments say
where a figure comes from and which are guesses.
"""

import argparse
import itertools
import shutil
import textwrap
from typing import Any

import msgspec

from groundlink.cli import Subparsers
from groundlink.core.errors import UserError
from groundlink.core.extras import needs
from groundlink.loader.datasheets import (
    CheckedDatasheet,
    load_datasheet,
    shipped_datasheets,
)
from groundlink.loader.scenario_files import SHEETS, SHIPPED
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.sensor_kinds import SensorKind, sensor_kinds

WIDTH = 110
"""Line width without a terminal."""

INDENT = 22
"""Indentation of the text beside the name of a sheet."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("sensors", help="list kinds of sensors and their data sheets")
    parser.set_defaults(command=sensors)
    more = parser.add_subparsers(metavar="[show]")
    one = more.add_parser("show", help="print a data sheet with its source")
    one.add_argument("sheet", help="its name, as in `vlp16`, or a file (YAML)")
    one.set_defaults(command=show)


def sensors(options: argparse.Namespace) -> int:
    """Print every kind of sensor with its data sheets: title and first parameters."""
    sheets = shipped_datasheets()
    width = max(shutil.get_terminal_size((WIDTH, 0)).columns, 2 * INDENT) - INDENT
    for kind in sensor_kinds().values():
        print(_kind(kind))
        for sheet in (sheet for sheet in sheets if sheet.kind == kind.name):
            lines = [textwrap.shorten(sheet.title, width, placeholder=" ...")]
            figures = ", ".join(_figures_text(sheet.figures))
            lines += textwrap.wrap(figures, width, max_lines=2, placeholder=" ...")
            for head, line in itertools.zip_longest([f"  {sheet.name} "], lines, fillvalue=""):
                print(f"{head:{INDENT}}{line}")
    print(f"\nDetails: `groundlink sensors show NAME`. Files: {SHIPPED / SHEETS}")
    return 0


def show(options: argparse.Namespace) -> int:
    """Print a data sheet: its kind, its file with comments, and the defaults that it uses."""
    if options.sheet in sensor_kinds().keys() - {sheet.name for sheet in shipped_datasheets()}:
        sheets = [sheet.name for sheet in shipped_datasheets() if sheet.kind == options.sheet]
        raise UserError(
            f"`{options.sheet}`: a kind of sensor; expected the name of a data sheet: "
            + (", ".join(sheets) or "none is shipped for this kind. Fix: write a data sheet")
        )
    sheet = load_datasheet(options.sheet)
    kind = sensor_kinds()[sheet.kind]
    print(f"{_kind(kind)}\n{sheet.file}\n")
    print(sheet.file.read_text(encoding="utf-8").strip())
    if left_out := ", ".join(_figures_text(_left_out(kind.spec, sheet))):
        text = f"Defaults of parameters that the sheet does not set: {left_out}."
        print(f"\n{textwrap.fill(text, WIDTH)}")
    return 0


def _kind(kind: SensorKind) -> str:
    """Return what a kind of sensor is and what it sends to ROS."""
    with needs("gateway"):
        from groundlink.ros.cdr import ROS_CODECS
    about = " ".join((kind.spec.__doc__ or "").partition("\n\n")[0].split())
    return f"{kind.name}, {ROS_CODECS[kind.streams['']].ros_type.rpartition('/')[2]}: {about}"


def _left_out(spec: type[SensorSpec], sheet: CheckedDatasheet) -> dict[str, Any]:
    """Return the defaults of the device's fields that a sheet does not state."""
    of_every_sensor = SensorSpec.__struct_fields__
    return {
        field.name: msgspec.to_builtins(field.default)
        for field in msgspec.structs.fields(spec)
        if field.name not in (*of_every_sensor, *sheet.figures) and not field.required
    }


def _figures_text(figures: dict[str, Any], prefix: str = "") -> list[str]:
    """Return parameters as short texts: a list by its length, a mapping by its items."""
    texts: list[str] = []
    for name, value in figures.items():
        if isinstance(value, dict):
            texts += _figures_text(value, f"{prefix}{name}.")
        elif isinstance(value, list | tuple):
            texts.append(f"{len(value) or 'no'} {prefix}{name}")
        elif value is None:
            texts.append(f"no {prefix}{name}")
        else:
            texts.append(f"{prefix}{name} {value}")
    return texts
