# SPDX-License-Identifier: Apache-2.0
"""The file of a data sheet that a fit gives."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import yaml

from groundlink.loader.datasheets import CheckedDatasheet


class FittedSheet(NamedTuple):
    """A data sheet with a recording's figures, and what to print of it."""

    fitted: str
    """What is the recording's: "noise and dropout"."""

    comments: Sequence[str]
    """Length of the recording and residuals, a line each."""

    figures: Mapping[str, Any]
    """Fields of the sheet, those of the base included."""

    notes: Mapping[str, Sequence[str]]
    """Comments above a field, by its name."""

    printed: Sequence[str]
    """Lines for a terminal."""

    document: Mapping[str, Any]
    """The same for programs."""


def sheet_text(
    base: CheckedDatasheet, source: str, sheet: FittedSheet, device: str | None = None
) -> str:
    """Return the text of a data sheet.

    Parameters
    ----------
    base : CheckedDatasheet
        The sheet of the device.
    source : str
        The recording, for the reader of the sheet.
    sheet : FittedSheet
    device : str or None
        Device of the recording, if it is another one than that of the base.
    """
    title = base.title if device is None else f"{device}, else as {base.name}"
    lines = [
        "# SPDX-License-Identifier: Apache-2.0",
        "# yaml-language-server: $schema=../schemas/datasheet.json",
        f"# Data sheet: {base.name} with {sheet.fitted} of a recording, by `groundlink fit`.",
        f"# The other figures: {base.name}.yaml, where their sources stand.",
        f"# Recording: {source}",
        *(f"# {comment}" for comment in sheet.comments),
        f"kind: {base.kind}",
        _yaml("datasheet", f"{title}; {sheet.fitted} of a recording"),
    ]
    for name, value in sheet.figures.items():
        if name not in sheet.notes:
            lines.append(_yaml(name, value))
            continue
        lines += ["", *(f"# {note}" for note in sheet.notes[name])]
        if isinstance(value, Mapping):
            lines += [f"{name}:", *(f"  {_yaml(*field)}" for field in value.items())]
        else:
            lines.append(_yaml(name, value))
    return "\n".join(lines) + "\n"


def short(value: float) -> float:
    """Return a figure with four digits."""
    return float(f"{value:.4g}")


def _yaml(name: str, value: Any) -> str:
    """Return one field on one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=math.inf, allow_unicode=True)
    return f"{name}: " + text.removesuffix("...\n").strip()
