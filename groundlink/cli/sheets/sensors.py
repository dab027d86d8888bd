# SPDX-License-Identifier: Apache-2.0
"""`groundlink sensors [show NAME]`: list kinds of sensors and data sheets, or print a data sheet.

Rule: everything is taken from where it is used: kinds from the table of topics and the classes of
their fields, sheets from their files. A sheet is shown as it is written, since its comments say
where a figure comes from and which are guesses.
"""

import argparse
import itertools
import textwrap
from typing import Any

import msgspec

from groundlink.cli import Subparsers
from groundlink.cli.terminal import output as terminal
from groundlink.cli.terminal.json_output import add_json_option, print_json
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

INDENT = 22
"""Indentation of the text beside the name of a sheet."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("sensors", help="list kinds of sensors and their data sheets")
    add_json_option(parser)
    parser.set_defaults(command=sensors)
    more = parser.add_subparsers(metavar="[show]")
    one = more.add_parser("show", help="print a data sheet with its source")
    one.add_argument("sheet", help="its name, as in `vlp16`, or a file (YAML)")
    add_json_option(one)
    one.set_defaults(command=show)


def sensors(options: argparse.Namespace) -> int:
    """Print every kind of sensor with its data sheets: title and first parameters."""
    sheets = {
        name: [sheet for sheet in shipped_datasheets() if sheet.kind == name]
        for name in sensor_kinds()
    }
    if options.json:
        print_json([_facts(kind, sheets[name]) for name, kind in sensor_kinds().items()])
        return 0
    width = max(terminal.width(), 2 * INDENT) - INDENT
    for name, kind in sensor_kinds().items():
        print(textwrap.fill(_kind(kind), width + INDENT, subsequent_indent="    "))
        for sheet in sheets[name]:
            lines = [textwrap.shorten(sheet.title, width, placeholder=" ...")]
            figures = ", ".join(_figures_text(sheet.figures))
            lines += textwrap.wrap(figures, width, max_lines=2, placeholder=" ...")
            for head, line in itertools.zip_longest([f"  {sheet.name} "], lines, fillvalue=""):
                print(f"{head:{INDENT}}{line}")
    print("\nDetails: `groundlink sensors show NAME`. Files:")
    print(SHIPPED / SHEETS)
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
    defaults = _left_out(kind.spec, sheet)
    if options.json:
        print_json({"kind": sheet.kind, **_sheet_facts(sheet), "defaults": defaults})
        return 0
    print(f"{_kind(kind)}\n{sheet.file}\n")
    print(sheet.file.read_text(encoding="utf-8").strip())
    if left_out := ", ".join(_figures_text(defaults)):
        text = f"Defaults of parameters that the sheet does not set: {left_out}."
        print(f"\n{textwrap.fill(text, terminal.width())}")
    return 0


def _facts(kind: SensorKind, sheets: list[CheckedDatasheet]) -> dict[str, Any]:
    return {
        "kind": kind.name,
        "type": _ros_type(kind),
        "description": _description(kind),
        "sheets": [_sheet_facts(sheet) for sheet in sheets],
    }


def _sheet_facts(sheet: CheckedDatasheet) -> dict[str, Any]:
    return {
        "name": sheet.name,
        "title": sheet.title,
        "file": str(sheet.file),
        "figures": sheet.figures,
    }


def _kind(kind: SensorKind) -> str:
    """Return what a kind of sensor is and what it sends to ROS."""
    return f"{kind.name}, {_ros_type(kind).rpartition('/')[2]}: {_description(kind)}"


def _ros_type(kind: SensorKind) -> str:
    with needs("gateway"):
        from groundlink.ros.cdr import ROS_CODECS
    return ROS_CODECS[kind.streams[""]].ros_type


def _description(kind: SensorKind) -> str:
    return " ".join((kind.spec.__doc__ or "").partition("\n\n")[0].split())


def _left_out(spec: type[SensorSpec], sheet: CheckedDatasheet) -> dict[str, Any]:
    """Return the defaults of the device's fields that a sheet does not state."""
    of_every_sensor = SensorSpec.__struct_fields__
    return {
        field.name: msgspec.to_builtins(
            field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
        )
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
