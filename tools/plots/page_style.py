# SPDX-License-Identifier: Apache-2.0
"""Style of the plots: SVG with text as text, on white for light and dark pages.

The same data give the same bytes with the same version of matplotlib.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, RED, VIOLET = "#1f77b4", "#e6850e", "#2a9d4a", "#c9302c", "#7b5ea7"
SERIES = (BLUE, ORANGE, GREEN, RED, VIOLET)
GRAY = "#777777"

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "groundlink",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.0,
    "figure.constrained_layout.use": True,
    "image.interpolation": "none",
}


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the style of the documents."""
    with mpl.rc_context(_STYLE):
        yield


def side_by_side(columns: int, *, height: float = 3.0) -> tuple[Figure, list[Axes]]:
    """Return a figure as wide as a page's text, and its axes from left to right."""
    figure = Figure(figsize=(8.4, height))
    return figure, list(figure.subplots(1, columns, squeeze=False)[0])


def label(axes: Axes, title: str, x: str, y: str) -> None:
    """Set the title of axes and the names of their quantities."""
    axes.set_title(title)
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def save(figure: Figure, file: Path) -> None:
    """Write a figure as SVG, without metadata, spare decimals and repeated styles."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    drawn = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text.getvalue(), flags=re.DOTALL)
    drawn = re.sub(r">\s+<", "><", drawn)
    drawn = re.sub(r' (?:d|x|y|transform)="[^"]*"', _rounded, drawn)
    drawn = re.sub(r'<g clip-path="[^"]*">(?:<use [^>]*/>)+</g>', _styled_once, drawn)
    file.write_text(drawn.strip() + "\n", encoding="utf-8")


def _rounded(attribute: re.Match[str]) -> str:
    """Return an attribute whose numbers have two decimals, a hundredth of a point."""
    return re.sub(r"(\.\d\d)\d+", r"\1", attribute[0].replace(" \n", " "))


def _styled_once(group: re.Match[str]) -> str:
    """Return a group of dots of one style with this style on the group alone."""
    styles = set(re.findall(r' style="[^"]*"', group[0]))
    if len(styles) != 1:
        return group[0]
    (style,) = styles
    return group[0].replace(style, "").replace("<g", f"<g{style}", 1)
