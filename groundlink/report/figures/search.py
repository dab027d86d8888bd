# SPDX-License-Identifier: Apache-2.0
"""Charts of a search as SVG: objective over number, histograms of fields, pairs of fields."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from groundlink.search.coverage import FieldCoverage
from groundlink.search.point_journal import PointRow
from groundlink.search.space import NumberRange, VariedField

from .svg_theme import BLUE, GRAY, MUTED, ORANGE, RED, style, svg

WIDTH_IN = 8.6
ACROSS = 3
"""Small plots side by side."""

SMALL_IN = 2.4
"""Height of a small plot."""

MAX_PAIRS = 15
"""Pairs of the first six fields."""

LABEL_LETTERS = 28
"""A longer label is shortened at its begin."""

TICK_LETTERS = 9
"""A longer value is shortened at its end."""

LIST_MARGIN = 0.2
"""Room beside the values of a list, as a share of the axis."""

MARKERS = {"passed": ("o", BLUE), "failed": ("X", RED), "broken": ("+", GRAY)}
"""Marker and color by verdict."""


def objective_chart(rows: Sequence[PointRow], objective: str, *, maximize: bool) -> str:
    """Return the objective of each point over its number, and the best so far."""
    with style():
        figure = Figure(figsize=(WIDTH_IN, 2.7))
        plot = figure.subplots()
        figure.subplots_adjust(left=0.1, right=0.985, bottom=0.17, top=0.9)
        shown = [row for row in rows if row.outcome.objective is not None]
        figures = np.array([row.outcome.objective for row in shown], dtype=float)
        best = np.maximum.accumulate(figures) if maximize else np.minimum.accumulate(figures)
        numbers = [row.number for row in shown]
        plot.step(numbers, best, where="post", color=ORANGE, label="best so far")
        _points(plot, shown, numbers, figures.tolist())
        plot.set_xlabel("number of the point")
        plot.set_ylabel(_label(objective))
        plot.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0)
        return svg(figure, "Objective of each point over its number")


def histograms(fields: Sequence[FieldCoverage]) -> str:
    """Return the number of points in each bin of each field."""
    with style():
        figure, plots = _small_plots(len(fields))
        for plot, covered in zip(plots, fields, strict=True):
            places = range(len(covered.counts))
            is_range = isinstance(covered.field, NumberRange)
            plot.bar(
                [place + 0.5 * is_range for place in places],
                covered.counts,
                width=0.92,
                color=BLUE,
            )
            step = math.ceil(len(places) / 5)
            labels = [_tick(text) for text in covered.field.bins]
            plot.set_xticks(places[::step], labels[::step])
            plot.yaxis.set_major_locator(MaxNLocator(4, integer=True))
            plot.set_xlabel(_label(covered.field.name))
            plot.set_ylabel("points")
        return svg(figure, "Number of points by value of each field")


def pairs(fields: Sequence[VariedField], rows: Sequence[PointRow]) -> str:
    """Return the points over each pair of fields, with the verdict of each."""
    chosen = list(itertools.combinations(fields, 2))[:MAX_PAIRS]
    with style():
        figure, plots = _small_plots(len(chosen))
        for plot, pair in zip(plots, chosen, strict=True):
            # A list has the longer labels, for which there is room below.
            across, up = sorted(pair, key=lambda field: isinstance(field, NumberRange))
            _points(
                plot,
                rows,
                [across.position(row.values.get(across.name)) for row in rows],
                [up.position(row.values.get(up.name)) for row in rows],
            )
            plot.set_xlabel(_label(across.name))
            plot.set_ylabel(_label(up.name))
            for axis, set_margin, field in (
                (plot.xaxis, plot.set_xmargin, across),
                (plot.yaxis, plot.set_ymargin, up),
            ):
                if not isinstance(field, NumberRange):
                    axis.set_ticks(range(field.count), list(map(_tick, field.bins)))
                    set_margin(LIST_MARGIN)
        plots[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0)
        return svg(figure, "Points over each pair of fields, with their verdicts")


def _points(plot: Axes, rows: Sequence[PointRow], x: Sequence[float], y: Sequence[float]) -> None:
    """Draw points by verdict; failures are on top."""
    for order, verdict in enumerate(("broken", "passed", "failed")):
        marker, color = MARKERS[verdict]
        chosen = [number for number, row in enumerate(rows) if row.outcome.verdict == verdict]
        if chosen:
            plot.plot(
                [x[number] for number in chosen],
                [y[number] for number in chosen],
                marker=marker,
                color=color,
                markersize=5 + 2 * (verdict == "failed"),
                linestyle="none",
                zorder=3 + order,
                label=verdict,
            )


def _small_plots(count: int) -> tuple[Figure, list[Axes]]:
    """Return a figure with small plots in rows."""
    high = math.ceil(count / ACROSS)
    height_in = SMALL_IN * high
    figure = Figure(figsize=(WIDTH_IN, height_in))
    figure.subplots_adjust(
        left=0.085,
        right=0.97,
        bottom=0.5 / height_in,
        top=1 - 0.3 / height_in,
        wspace=0.34,
        hspace=0.5,
    )
    plots = [figure.add_subplot(high, ACROSS, number + 1) for number in range(count)]
    for plot in plots:
        plot.tick_params(colors=MUTED)
    return figure, plots


def _label(text: str) -> str:
    """Return a text for a label: its end, without formulas."""
    short = text if len(text) <= LABEL_LETTERS else f"...{text[-LABEL_LETTERS:]}"
    return short.replace("$", r"\$")


def _tick(text: str) -> str:
    """Return a value for a label: its begin, without formulas."""
    short = text if len(text) <= TICK_LETTERS else f"{text[:TICK_LETTERS]}..."
    return short.replace("$", r"\$")
