# SPDX-License-Identifier: Apache-2.0
"""Figures of experiments: true and estimated trajectories over the plan, maps beside the plan."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon
from matplotlib.transforms import Affine2D
from PIL import Image

from experiments.estimation.checkpoints import CheckpointError
from experiments.experiment import AlignedEstimate
from groundlink.data.trajectory import Trajectory
from groundlink.report.analysis.plan import outlines
from groundlink.scenario import Scenario
from groundlink.scene.build import solids

COLORS = ("#c0392b", "#2471a3", "#d68910", "#7d3c98", "#1e8449")
TRUTH = "#1b1b1b"
TALL_M = 1.6
BARREL_RADIUS_M = 0.29
AROUND_M = 3.0
"""Of a world that is larger than the way, so much around it is shown."""


def plan(axes: Axes, scenario: Scenario) -> None:
    """Draw what stands in the world, from above."""
    level = scenario.world.terrain is None
    for outline in outlines(solids(scenario), level=level):
        tall = outline.high_m > TALL_M
        axes.add_patch(
            Polygon(
                outline.corners_m,
                facecolor="#9aa0a6" if tall else "#dcdfe3",
                edgecolor="#80868b",
                linewidth=0.4,
            )
        )
    axes.set_aspect("equal")
    axes.set_xlabel("x (east), m")
    axes.set_ylabel("y (north), m")


def trajectories(file: Path, scenario: Scenario, ways: Sequence[AlignedEstimate]) -> None:
    """Draw the true way and what programs made of it over the world."""
    figure, axes = plt.subplots(figsize=(8, 5.6), layout="constrained")
    plan(axes, scenario)
    truth = max((way.truth for way in ways), key=lambda truth: truth.length_m).positions_m
    axes.plot(truth[:, 0], truth[:, 1], color=TRUTH, linewidth=2.4, label="true")
    for way, color in zip(ways, COLORS, strict=False):
        at = way.estimate.positions_m
        axes.plot(at[:, 0], at[:, 1], color=color, linewidth=1.0, label=way.label)
    low, high = truth[:, :2].min(axis=0) - AROUND_M, truth[:, :2].max(axis=0) + AROUND_M
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    figure.legend(loc="outside upper center", ncols=5, frameon=False)
    figure.savefig(file, dpi=130)
    plt.close(figure)


def navigation(
    file: Path,
    scenario: Scenario,
    paths: Sequence[Trajectory],
    *,
    goals_m: Sequence[tuple[float, float]],
    barrels_m: Sequence[tuple[float, float]],
) -> None:
    """Draw the driven path of each leg over the world, with its goal and the barrel in its way."""
    figure, axes = plt.subplots(figsize=(8, 5.6), layout="constrained")
    plan(axes, scenario)
    legs = zip(paths, goals_m, barrels_m, COLORS, strict=False)
    for number, (path, goal, barrel, color) in enumerate(legs, 1):
        axes.add_patch(Circle(barrel, BARREL_RADIUS_M, facecolor=color))
        axes.annotate(str(number), barrel, color="white", ha="center", va="center")
        axes.plot(*goal, color=color, marker="x", markersize=9, markeredgewidth=2)
        axes.plot(*path.positions_m[:, :2].T, color=color, linewidth=1.6, label=f"leg {number}")
    axes.autoscale_view()
    figure.legend(loc="outside upper center", ncols=5, frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def accumulated_errors(file: Path, curves: Mapping[str, Sequence[CheckpointError]]) -> None:
    """Draw sums of squared distances over the way, as the paper's Figure 10 does."""
    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    for index, (name, passed) in enumerate(curves.items()):
        axes.plot(
            [one.travelled_m for one in passed],
            [one.sum_mm2 for one in passed],
            color=COLORS[index // 2 % len(COLORS)],
            linestyle="-" if index % 2 else "--",
            marker="o",
            markersize=3,
            label=name,
        )
    axes.set_yscale("symlog", linthresh=10.0)
    axes.set_xlabel("way, m")
    axes.set_ylabel("sum of squared distances at checkpoints, mm$^2$")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(file, dpi=130)
    plt.close(figure)


def map_beside_plan(file: Path, scenario: Scenario, map_yaml: Path, way: AlignedEstimate) -> None:
    """Draw the plan of the world, and beside it an occupancy grid as map_server has it.

    Parameters
    ----------
    way
        of the program that made the map; how it was aligned says how the map lies in the world.
    """
    told = yaml.safe_load(map_yaml.read_text(encoding="utf-8"))
    image = np.asarray(Image.open(map_yaml.parent / told["image"]))
    height, width = image.shape
    x, y, _ = told["origin"]
    size = told["resolution"]
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(13, 5), layout="constrained", sharex=True, sharey=True
    )
    plan(left, scenario)
    left.autoscale_view()
    left.set_title("the world")
    limits = left.get_xlim(), left.get_ylim()
    drawn = right.imshow(
        image,
        cmap="gray",
        vmin=0,
        vmax=255,
        extent=(x, x + width * size, y, y + height * size),
        interpolation="nearest",
    )
    drawn.set_transform(_world_from_map(way) + right.transData)
    right.set_facecolor("#cdcdcd")
    right.set_aspect("equal")
    right.set_xlim(limits[0])
    right.set_ylim(limits[1])
    right.set_xlabel("x (east), m")
    right.set_title(f"the map of {way.label}")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _world_from_map(way: AlignedEstimate) -> Affine2D:
    """Return how an estimate was put over the truth, in the plane."""
    raw, aligned = way.raw.positions_m[:, :2], way.estimate.positions_m[:, :2]
    a, b = raw - raw.mean(axis=0), aligned - aligned.mean(axis=0)
    turn = math.atan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    turned = Affine2D().rotate(turn)
    shift = aligned.mean(axis=0) - turned.transform(raw.mean(axis=0))
    return turned.translate(*shift)
