# SPDX-License-Identifier: Apache-2.0
"""Charts of a vehicle's trials as SVG."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from groundlink.report.analysis.trials import Trial, TrialPlot

from .svg_theme import BLUE, MUTED, ORANGE, WALL, style, svg

WIDTH_IN, HEIGHT_IN = 8.6, 2.4

COLORS = {"true": BLUE, "commanded": ORANGE, "ground": WALL}


LEAST_M = 0.2
"""Extent of a map of a vehicle that stays where it is."""

LEAST_SHARE = 1e-3
"""Smaller changes than this share of a value are drawn as none."""


def trial_plots(trial: Trial) -> str:
    """Return the plots of a trial side by side."""
    with style():
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN))
        plots = figure.subplots(1, len(trial.plots), squeeze=False)[0]
        figure.subplots_adjust(left=0.08, right=0.985, bottom=0.2, top=0.88, wspace=0.22)
        for plot, drawn in zip(plots, trial.plots, strict=True):
            for curve in drawn.curves:
                color = COLORS.get(curve.name, MUTED)
                plot.plot(curve.x, curve.y, color=color, label=curve.name)
            plot.set_xlabel(drawn.x_label)
            plot.set_ylabel(drawn.y_label)
            plot.ticklabel_format(useOffset=False)
            _widen(plot, drawn)
            if len(drawn.curves) > 1:
                plot.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0)
        return svg(figure, trial.description)


def _widen(plot: Axes, drawn: TrialPlot) -> None:
    """Give axes at least an extent, so that rounding errors do not fill the plot."""
    if drawn.equal:
        plot.set_aspect("equal", adjustable="datalim")
    low, high = plot.get_ylim()
    least = LEAST_M if drawn.equal else LEAST_SHARE * max(abs(low), abs(high))
    if high - low < least:
        plot.set_ylim((low + high - 1) / 2, (low + high + 1) / 2)
