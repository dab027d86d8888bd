# SPDX-License-Identifier: Apache-2.0
"""Figures of sensor readings compared with the ground truth."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from groundlink.report.analysis.plan import SolidOutline
from groundlink.report.analysis.sensors import ImuSamples

from .charts import SPEED_COLORS, WIDTH_IN, Span
from .plan import plan
from .svg_theme import BLUE, GREEN, ORANGE, SERIES, TEXT, style, svg

Floats = NDArray[np.float64]

CLOUD_DPI = 220

FLAT_M = 0.1

MARKED_AT_MOST = 100
"""Of fewer places each has a mark."""


def imu(samples: ImuSamples, truth: Floats, span: Span) -> str:
    """Return turn rate, with the true yaw rate of the base, and specific force over time."""
    rows = np.array(samples.rows)
    with style():
        figure = Figure(figsize=(WIDTH_IN, 3.8))
        plots = figure.subplots(2, 1, sharex=True)
        figure.subplots_adjust(left=0.085, right=0.985, bottom=0.12, top=0.92, hspace=0.32)
        for plot, first, unit in zip(plots, (1, 4), ("turn rate, rad/s", "m/s\u00b2"), strict=True):
            for axis, color in enumerate((ORANGE, GREEN, BLUE)):
                values = rows[:, first + axis]
                plot.plot(rows[:, 0], values, color=color, linewidth=0.8, label="xyz"[axis])
            plot.set_ylabel(unit)
        if len(truth):
            plots[0].plot(
                truth[:, 0],
                truth[:, 4],
                color=TEXT,
                linewidth=0.9,
                label="true yaw rate",
            )
        for plot in plots:
            plot.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0)
        plots[0].set_xlim(*span)
        plots[1].set_xlabel("sim time, s")
        return svg(figure, f"Samples of {samples.topic} over time")


def trajectories(
    truth: Floats, estimates: Sequence[tuple[str, Floats]], vehicle: str, span: Span
) -> str:
    """Return estimated trajectories over the truth, and their errors over time.

    Parameters
    ----------
    estimates
        topics, each with time, x, y and distance to the truth.
    """
    with style():
        figure = Figure(figsize=(WIDTH_IN, 3.7))
        above, over_time = figure.subplots(1, 2)
        figure.subplots_adjust(left=0.075, right=0.985, bottom=0.14, top=0.86, wspace=0.22)
        for number, (topic, rows) in enumerate(estimates):
            color = SERIES[number % len(SERIES)]
            marks = "." if len(rows) < MARKED_AT_MOST else ""
            above.plot(rows[:, 1], rows[:, 2], color=color, marker=marks, linewidth=0.9)
            over_time.plot(rows[:, 0], rows[:, 3], color=color, linewidth=1.0, label=topic)
        above.plot(truth[:, 1], truth[:, 2], color=TEXT, linewidth=1.4, label="truth")
        above.set_aspect("equal", adjustable="datalim")
        above.set_xlabel("x (east), m")
        above.set_ylabel("y (north), m")
        over_time.set_xlim(*span)
        over_time.set_ylim(bottom=0.0)
        over_time.set_xlabel("sim time, s")
        over_time.set_ylabel("off the truth, m")
        figure.legend(loc="upper right", bbox_to_anchor=(0.985, 0.99), ncols=4, borderaxespad=0)
        return svg(figure, f"Where sensors say that {vehicle} is, beside the truth")


def cloud(
    points: Floats,
    outlines: Sequence[SolidOutline],
    place: tuple[float, float],
    reach_m: float,
    topic: str,
) -> str:
    """Return one cloud from above over the plan of the world, colored by height.

    Points are one picture within the drawing: each on its own would be megabytes.
    """
    with style():
        figure = Figure(figsize=(WIDTH_IN, 5.2), dpi=CLOUD_DPI)
        plot = figure.add_axes((0.075, 0.1, 0.78, 0.87))
        plan(plot, outlines)
        order = np.argsort(points[:, 2], kind="stable")
        x, y, z = points[order].T
        low, high = np.quantile(z, (0.02, 0.98)) if len(z) else (0.0, 0.0)
        if high - low < FLAT_M:  # the plane of a scan, in the middle of the colors
            low, high = low - 1.0, high + 1.0
        drawn = plot.scatter(
            x,
            y,
            c=z,
            s=0.8,
            linewidths=0,
            cmap=SPEED_COLORS,
            vmin=low,
            vmax=high,
            rasterized=True,
            zorder=3,
        )
        plot.plot(*place, marker="o", markersize=6, color=TEXT, linestyle="none", zorder=4)
        plot.set_xlim(place[0] - 1.3 * reach_m, place[0] + 1.3 * reach_m)
        plot.set_ylim(place[1] - reach_m, place[1] + reach_m)
        plot.set_aspect("equal")
        plot.set_xlabel("x (east), m")
        plot.set_ylabel("y (north), m")
        bar = figure.colorbar(drawn, cax=figure.add_axes((0.89, 0.25, 0.015, 0.5)))
        bar.set_label("above the base, m")
        bar.outline.set_visible(False)
        return svg(figure, f"One cloud of {topic} from above")
