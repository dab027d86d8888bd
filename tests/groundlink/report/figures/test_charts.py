# SPDX-License-Identifier: Apache-2.0
"""What pictures show is where it belongs, in its color: read from the SVG that a page holds."""

import re
from typing import NamedTuple

import numpy as np
import pytest

from groundlink.core.clock import NANOS
from groundlink.report.analysis.diagnostics import StreamHistory
from groundlink.report.analysis.energy import Energy
from groundlink.report.analysis.motion import VehicleMotion
from groundlink.report.analysis.plan import SolidOutline
from groundlink.report.analysis.streams import StreamTimes
from groundlink.report.figures import charts as figures
from groundlink.world.terrain import Ground


class Drawn(NamedTuple):
    """A path of a picture."""

    x: np.ndarray[tuple[int], np.dtype[np.float64]]
    y: np.ndarray[tuple[int], np.dtype[np.float64]]
    """Downward."""

    style: str


def paths(svg: str) -> list[Drawn]:
    """Return every path that has a color."""
    found = []
    for tag in re.findall(r"<path[^>]*>", svg):
        style = re.search(r'style="([^"]*)"', tag)
        points = re.findall(r"[ML] (-?[0-9.]+) (-?[0-9.]+)", tag)
        if style and points:
            x, y = np.array(points, np.float64).T
            found.append(Drawn(x, y, style[1]))
    return found


def labels(svg: str) -> dict[str, tuple[float, float]]:
    """Return where texts are; of the same words those farthest to the left."""
    found: dict[str, tuple[float, float]] = {}
    for tag, words in re.findall(r"(<text[^>]*>)([^<]*)</text>", svg):
        if at := re.search(r"translate\((-?[0-9.]+) (-?[0-9.]+)\)|x=\"(\S+)\" y=\"(\S+)\"", tag):
            x, y = (float(each) for each in at.groups() if each is not None)
            found[words] = min(found.get(words, (x, y)), (x, y))
    return found


def stream(topic: str, seconds: list[float]) -> StreamTimes:
    found = StreamTimes(topic, "type", 10.0, first_nanos=0, last_nanos=6 * NANOS)
    for each in seconds:
        found.add(round(each * NANOS), 1)
    return found


def test_bars_are_green_orange_and_red_where_they_should_be() -> None:
    """Two seconds whole, two with half of the messages, two with none."""
    seconds = [i / 10 for i in range(20)] + [2 + i / 5 for i in range(10)]
    svg = figures.rates([stream("/imu", seconds)], (0.0, 6.0))
    bars = {
        name: [path for path in paths(svg) if f"fill: var(--{name})" in path.style]
        for name in ("green", "orange", "red")
    }
    spans = {name: (row.x.min(), row.x.max()) for name, (row,) in bars.items()}
    widths = {name: high - low for name, (low, high) in spans.items()}
    assert widths["green"] == pytest.approx(widths["orange"], rel=0.01)
    assert widths["green"] == pytest.approx(widths["red"], rel=0.01)
    assert spans["green"][1] == pytest.approx(spans["orange"][0], abs=0.1)
    assert spans["orange"][1] == pytest.approx(spans["red"][0], abs=0.1)


def test_the_median_is_a_line_and_what_99_percent_do_not_exceed_is_dashed_above_it() -> None:
    words = StreamHistory({})
    words.ages = [(float(t), 0.004, 0.040) for t in range(6)]
    svg = figures.ages({("/imu", "to ROS"): words}, (0.0, 5.0))
    lines = [path for path in paths(svg) if "stroke: var(--blue)" in path.style and len(path.x) > 3]
    (median,) = (line for line in lines if "dasharray" not in line.style)
    (worst,) = (line for line in lines if "dasharray" in line.style)
    assert worst.y.max() < median.y.min() - 20
    # The scale is logarithmic above 1 ms: 40 ms is a decade above 4 ms.
    assert np.ptp(worst.y) == np.ptp(median.y) == 0
    at = labels(svg)
    assert worst.y[0] < at["10"][1] < median.y[0] < at["1"][1] < at["0"][1]


def test_speed_is_in_the_upper_panel_and_yaw_rate_in_the_lower() -> None:
    motion = VehicleMotion("rover", 1)
    motion.rows = [(t, t * t / 2, 0.0, float(t), -0.25, 0.0) for t in range(6)]
    motion.asked = [(float(t), 5.0 - t, -0.25) for t in range(6)]
    svg = figures.speed(motion, (0.0, 5.0))
    at = labels(svg)
    upper, lower = at["speed, m/s"][1], at["yaw rate, rad/s"][1]
    assert upper < lower
    for color, slope in (("blue", -1), ("orange", 1)):  # on the screen y is downward
        found = [
            path
            for path in paths(svg)
            if f"stroke: var(--{color})" in path.style and len(path.x) > 5
        ]
        (fast,) = (path for path in found if np.ptp(path.y) > 1)
        (steady,) = (path for path in found if np.ptp(path.y) < 1e-6)
        assert fast.y.mean() < steady.y.mean()
        assert np.sign(fast.y[-1] - fast.y[0]) == slope


def test_names_of_topics_are_whole() -> None:
    topic = "/front_left_camera/image_raw/compressed"
    svg = figures.rates([stream(topic, [0.0])], (0.0, 6.0))
    (width,) = re.findall(r'viewBox="0 0 ([0-9.]+) ', svg)
    bar = min(path.x.min() for path in paths(svg) if "fill: var(--red)" in path.style)
    size = float(re.search(rf"font-size: ([0-9.]+)px[^>]*>{topic}<", svg)[1])  # type: ignore[index]
    assert bar > 0.55 * size * len(topic)
    assert bar < 0.6 * float(width)


def test_terrain_is_drawn_below_the_way() -> None:
    x = np.linspace(0, 1, 11, dtype=np.float32)
    slope = Ground(
        heights=np.tile(x, (11, 1)),
        surface=np.zeros((10, 10), np.uint8),
        cell_m=2.0,
        x0_m=-10.0,
        y0_m=-10.0,
        materials=("grass",),
    )
    motion = VehicleMotion("rover", 1)
    motion.rows = [(float(t), t - 2.5, 0.0, 1.0, 0.0, 0.0) for t in range(6)]
    bare, drawn = (
        figures.trajectory([], [motion], [Energy("rover", 1)], [], {}, ground)
        for ground in (None, slope)
    )
    lines = [path for path in paths(drawn) if "stroke: var(--gray)" in path.style]
    assert not [path for path in paths(bare) if "stroke: var(--gray)" in path.style]
    assert len(lines) >= 4
    assert all(np.ptp(line.x) < 0.05 * max(np.ptp(line.y), 1) for line in lines)  # uphill to x
    assert re.search(r">0\.[0-9]+ m<", drawn)


def test_of_a_large_world_what_is_near_the_path_is_shown_on_every_side() -> None:
    places = np.array([[0.0, 0.0], [3.0, 2.0]])
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    sides = ((-2.0, 1.0), (5.0, 1.0), (1.5, -2.0), (1.5, 4.0))
    near = [SolidOutline("near", square + side, 0.0, 1.0) for side in sides]
    far = SolidOutline("far", square + 2 * figures.WHOLE_M, 0.0, 1.0)
    low, high = figures._shown([*near, far], places)
    for outline in near:
        assert (outline.corners_m >= low).all()
        assert (outline.corners_m <= high).all()
    assert (high < far.corners_m.min(axis=0)).all()
