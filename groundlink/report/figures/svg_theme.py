# SPDX-License-Identifier: Apache-2.0
"""SVG theme: matplotlib figures in the font and colors of the page, light or dark.

A figure is drawn in placeholder colors, which become variables of the style sheet. Text stays text.
The same data give the same bytes.
"""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_NAMES = (
    *("ink", "faint", "line", "body", "wall", "furniture"),
    *("blue", "orange", "green", "red", "violet", "gray"),
)
VARIABLES = {
    f"#{number:02x}{number:02x}{number:02x}": name for number, name in enumerate(_NAMES, 1)
}
"""Stand-in colors, and the page's variables that take their place."""

TEXT, MUTED, LINE, BODY, WALL, FURNITURE, BLUE, ORANGE, GREEN, RED, VIOLET, GRAY = VARIABLES
SERIES = (BLUE, ORANGE, GREEN, VIOLET, RED, GRAY)

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "groundlink",
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": LINE,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": LINE,
    "grid.linewidth": 0.6,
    "xtick.color": LINE,
    "ytick.color": LINE,
    "xtick.labelcolor": MUTED,
    "ytick.labelcolor": MUTED,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "text.color": TEXT,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}


@contextmanager
def style() -> Iterator[None]:
    """Draw in the page's manner."""
    with mpl.rc_context(_STYLE):
        yield


def axes(figure: Figure, seconds: tuple[float, float]) -> Axes:
    """Return axes over the run's time."""
    plot = figure.subplots()
    plot.set_xlim(*seconds)
    plot.set_xlabel("sim time, s")
    return plot


def svg(figure: Figure, label: str) -> str:
    """Return a figure as an SVG element for a page, with an accessible label."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    drawn = text.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    # Of the names that matplotlib gives to groups none is used, and each would be there many times.
    drawn = re.sub(r'<g id="[^"]*"', "<g", drawn)
    for stand_in, variable in VARIABLES.items():
        drawn = drawn.replace(stand_in, f"var(--{variable})")
    # The type is the page's, and the width that of its column.
    drawn = re.sub(r"font: ([0-9.]+px)[^;\"]*", r"font-size: \1", drawn)
    drawn = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", drawn, count=1)
    drawn = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", drawn, count=1)
    return drawn.replace("<svg", f'<svg role="img" aria-label="{label}"', 1).strip()
