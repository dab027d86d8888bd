# SPDX-License-Identifier: Apache-2.0
"""Charts of a run as SVG: trajectory, speed, rates, ages and energy."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from groundlink.report.analysis.diagnostics import StreamHistory
from groundlink.report.analysis.energy import Energy
from groundlink.report.analysis.motion import VehicleMotion
from groundlink.report.analysis.plan import SolidOutline
from groundlink.report.analysis.streams import StreamTimes
from groundlink.world.terrain import Ground

from .plan import heights, plan
from .svg_theme import BLUE, BODY, GREEN, MUTED, ORANGE, RED, SERIES, TEXT, axes, style, svg

WIDTH_IN = 8.6
LEFT_IN = 0.65
"""Left margin of the plan."""

MARGIN_M = 0.4
MIN_EXTENT_M = 4.0
WHOLE_M = 40.0
"""Larger worlds are cropped around the trajectory."""

FAR_M = 2.5
"""Margin of a cropped world."""

SPEED_COLORS = LinearSegmentedColormap.from_list(
    "speed", ["#3b4cc0", "#2a8fbd", "#1fa187", "#8fc93a", "#f2b134"]
)
"""Slow to fast; each stands out from a light and from a dark page."""

LETTER_IN = 0.073
"""Width of a letter of an axis label."""

Span = tuple[float, float]


def trajectory(
    outlines: Sequence[SolidOutline],
    motions: Sequence[VehicleMotion],
    energies: Sequence[Energy],
    route_m: Sequence[NDArray[np.float64]],
    checkpoints_m: Mapping[str, tuple[float, float]],
    ground: Ground | None = None,
) -> str:
    """Return the trajectories of all vehicles over the plan, colored by speed.

    Parameters
    ----------
    ground
        terrain whose heights are drawn below.
    """
    tracks = [motion.track() for motion in motions]
    places = np.vstack([track[:, 1:3] for track in tracks])
    low, high = _shown(outlines, places)
    width, height = high - low
    with style():
        # In inches: the plan, room for numbers to its left and below, the scale of speed beside.
        plan_width = min(WIDTH_IN - 1.5, 7.0 * width / height)
        plan_height = plan_width * height / width
        figure = Figure(figsize=(WIDTH_IN, plan_height + 0.62))
        box = np.array([LEFT_IN, 0.52, plan_width, plan_height])
        inches = np.array([WIDTH_IN, plan_height + 0.62] * 2)
        plot = figure.add_axes(tuple(box / inches))
        plot.set_axisbelow(True)
        if ground is not None:
            heights(plot, ground, low, high)
        plan(plot, outlines)
        for line in route_m:
            plot.plot(*line.T, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), label="route")
        top = max((motion.top_speed_mps for motion in motions), default=0.0) or 1.0
        drawn = None
        for motion, track in zip(motions, tracks, strict=True):
            points = track[:, None, 1:3]
            pieces = LineCollection(
                list(np.concatenate([points[:-1], points[1:]], axis=1)),
                cmap=SPEED_COLORS,
                linewidth=2.6,
                capstyle="round",
            )
            pieces.set_array(np.abs(track[1:, 3]))
            pieces.set_clim(0.0, top)
            drawn = plot.add_collection(pieces)
            _ends(plot, motion.vehicle if len(motions) > 1 else "", track)
        for motion, energy in zip(motions, energies, strict=True):
            _contacts(plot, motion, energy)
        for name, place in checkpoints_m.items():
            plot.plot(*place, marker="+", markersize=9, color=TEXT, linestyle="none", zorder=4)
            plot.annotate(name, place, (4, 4), textcoords="offset points", color=MUTED)
        plot.set_xlim(low[0], high[0])
        plot.set_ylim(low[1], high[1])
        plot.set_aspect("equal")
        plot.set_xlabel("x (east), m", loc="left")
        plot.set_ylabel("y (north), m")
        if drawn is not None:
            beside = np.array(
                [LEFT_IN + plan_width + 0.15, 0.52 + 0.15 * plan_height, 0.13, 0.7 * plan_height]
            )
            bar = figure.colorbar(drawn, cax=figure.add_axes(tuple(beside / inches)))
            bar.set_label("speed, m/s", color=MUTED)
            bar.outline.set_visible(False)
        _legend(plot, loc="upper right", bbox_to_anchor=(1.0, -0.3 / plan_height), ncols=4)
        return svg(figure, "Trajectory from above over the plan of the world")


def _shown(
    outlines: Sequence[SolidOutline], places: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of the visible area around the trajectories and nearby obstacles."""
    low, high = places.min(axis=0) - MARGIN_M, places.max(axis=0) + MARGIN_M
    near_low, near_high = low - FAR_M, high + FAR_M
    if outlines:
        corners = np.vstack([outline.corners_m for outline in outlines])
        if np.all(np.ptp(corners, axis=0) <= WHOLE_M):
            near_low, near_high = corners.min(axis=0) - 1, corners.max(axis=0) + 1
    for outline in outlines:
        corner, far = outline.corners_m.min(axis=0), outline.corners_m.max(axis=0)
        if np.all(far > near_low) and np.all(corner < near_high):
            low, high = np.minimum(low, corner - 0.1), np.maximum(high, far + 0.1)
    lack = np.maximum(MIN_EXTENT_M - (high - low), 0.0) / 2
    return low - lack, high + lack


def _legend(plot: Axes, **where: Any) -> None:
    """Add a legend that has each label once."""
    handles, labels = plot.get_legend_handles_labels()
    known = dict(zip(labels, handles, strict=True))
    plot.legend(known.values(), known.keys(), borderaxespad=0, **where)


def _ends(plot: Axes, name: str, track: NDArray[np.float64]) -> None:
    label = f"{name}: " if name else ""
    for row, marker, color, word in ((0, "o", GREEN, "start"), (-1, "s", TEXT, "end")):
        plot.plot(
            *track[row, 1:3],
            marker=marker,
            markersize=7,
            markerfacecolor=color,
            markeredgecolor=BODY,
            linestyle="none",
            zorder=5,
            label=label + word,
        )


def _contacts(plot: Axes, motion: VehicleMotion, energy: Energy) -> None:
    places = [motion.place(event.begin_seconds) for event in energy.events]
    known = [place for place in places if place is not None]
    if known:
        plot.plot(
            *zip(*known, strict=True),
            marker="X",
            markersize=9,
            markerfacecolor=RED,
            markeredgecolor=BODY,
            linestyle="none",
            zorder=6,
            label="contact",
        )


def speed(motion: VehicleMotion, span: Span) -> str:
    """Return speed and yaw rate over time, with the commands."""
    track, asked = motion.track(), np.array(motion.asked).reshape(-1, 3)
    with style():
        figure = Figure(figsize=(WIDTH_IN, 3.4))
        plots = figure.subplots(2, 1, sharex=True)
        figure.subplots_adjust(left=0.075, right=0.985, bottom=0.13, top=0.93, hspace=0.16)
        for plot, column, unit in zip(
            plots, (3, 4), ("speed, m/s", "yaw rate, rad/s"), strict=True
        ):
            if len(asked):
                plot.step(
                    asked[:, 0],
                    asked[:, column - 2],
                    where="post",
                    color=ORANGE,
                    linewidth=0.9,
                    label="commanded",
                )
            plot.plot(track[:, 0], track[:, column], color=BLUE, label="true")
            plot.set_ylabel(unit)
        plots[0].set_xlim(*span)
        plots[1].set_xlabel("sim time, s")
        plots[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0)
        return svg(figure, f"Speed and yaw rate of {motion.vehicle} over time")


def rates(streams: Sequence[StreamTimes], span: Span) -> str:
    """Return the rate of each declared stream in bins of time."""
    declared = [(stream, stream.bins()) for stream in streams]
    rows = [(stream, bins) for stream, bins in declared if bins is not None]
    with style():
        figure = Figure(figsize=(WIDTH_IN, 0.55 + 0.24 * len(rows)))
        plot = axes(figure, span)
        letters = max((len(stream.topic) for stream, _ in rows), default=0)
        figure.subplots_adjust(
            left=(LETTER_IN * letters + 0.15) / WIDTH_IN,
            right=0.985,
            bottom=0.42 / (0.55 + 0.24 * len(rows)),
            top=0.98,
        )
        plot.grid(visible=False)
        for number, (_, bins) in enumerate(rows):
            edges = span[0] + bins.edges_s
            for color, chosen in (
                (GREEN, bins.kept),
                (ORANGE, ~bins.kept & ~bins.silent),
                (RED, ~bins.kept & bins.silent),
            ):
                pieces = [
                    (float(edges[i]), float(edges[i + 1] - edges[i]))
                    for i in np.flatnonzero(chosen).tolist()
                ]
                plot.broken_barh(_merged(pieces), (number - 0.33, 0.66), facecolors=color)
        plot.set_yticks(range(len(rows)), [stream.topic for stream, _ in rows])
        plot.set_ylim(len(rows) - 0.5, -0.5)
        plot.tick_params(axis="y", length=0)
        plot.spines["left"].set_visible(False)
        return svg(figure, "Rate of each declared stream over time")


def _merged(pieces: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join bars that touch, so that a run without gaps is one bar."""
    joined: list[tuple[float, float]] = []
    for begin, width in pieces:
        if joined and abs(joined[-1][0] + joined[-1][1] - begin) < 1e-9:
            joined[-1] = joined[-1][0], joined[-1][1] + width
        else:
            joined.append((begin, width))
    return joined


def ages(streams: dict[tuple[str, str], StreamHistory], span: Span) -> str:
    """Return the median age of each stream over time, and what 99 % do not exceed."""
    with style():
        figure = Figure(figsize=(WIDTH_IN, 2.7))
        plot = axes(figure, span)
        figure.subplots_adjust(left=0.075, right=0.8, bottom=0.17, top=0.96)
        shown = [(key, words) for key, words in streams.items() if words.ages]
        for number, ((topic, direction), words) in enumerate(shown):
            times, median, worst = np.array(words.ages).T
            color = SERIES[number % len(SERIES)]
            back = "" if direction == "to ROS" else " (back)"
            plot.plot(times, 1e3 * median, color=color, label=topic + back)
            plot.plot(times, 1e3 * worst, color=color, linewidth=0.8, linestyle=(0, (3, 2)))
        plot.set_yscale("symlog", linthresh=1.0)
        plot.yaxis.set_major_formatter("{x:g}")
        plot.set_ylim(bottom=0.0)
        plot.set_ylabel("age, ms")
        plot.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), title="median, - - 99 %")
        return svg(figure, "Age of messages over time")


def energy(energies: Sequence[Energy], span: Span) -> str:
    """Return the motors' work over time, with the contacts."""
    with style():
        figure = Figure(figsize=(WIDTH_IN, 2.6))
        plot = axes(figure, span)
        figure.subplots_adjust(left=0.11, right=0.985, bottom=0.18, top=0.9)
        for number, one in enumerate(energies):
            times, work, braked = np.array(one.rows).reshape(-1, 3).T
            name = f"{one.vehicle}: " if len(energies) > 1 else ""
            plot.plot(
                times, work, color=SERIES[2 * number % len(SERIES)], label=f"{name}work of motors"
            )
            plot.plot(
                times, braked, color=SERIES[(2 * number + 1) % len(SERIES)], label=f"{name}braked"
            )
            for event in one.events:
                plot.axvspan(
                    event.begin_seconds,
                    max(event.end_seconds, event.begin_seconds + 0.002 * (span[1] - span[0])),
                    color=RED,
                    alpha=0.35,
                    linewidth=0,
                    label="contact",
                )
        plot.set_ylim(bottom=0.0)
        plot.set_ylabel("energy, J")
        _legend(plot, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        return svg(figure, "Work of the motors over time")
