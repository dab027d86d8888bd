# SPDX-License-Identifier: Apache-2.0
"""The picture of a clause: curves or points over one axis, and limits as lines.

`plot` draws any curves. The others are those of the usual kinds of checks: messages that are wrong
are counted, numbers have names, and a resolution shows in distinct values.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MOST_POINTS = 600
"""Points of a curve in a picture; of longer ones every n-th is drawn."""


@dataclass(frozen=True)
class Curve:
    """Points of one color."""

    name: str
    x: Floats
    y: Floats
    is_line: bool = True


@dataclass(frozen=True)
class ClausePlot:
    """A picture, independent of how it is drawn."""

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    limits: tuple[float, ...] = field(default=())
    """Values of y at which the clause draws its line."""
    names: tuple[str, ...] = ()
    """What stands at x = 0, 1, ... instead of numbers."""


def plot(
    x_label: str,
    y_label: str,
    *curves: tuple[str, NDArray[Any], NDArray[Any]],
    limits: tuple[float, ...] = (),
    dots: bool = False,
) -> ClausePlot:
    """Return a picture of curves, each given by name, x and y."""
    drawn = []
    for name, x, y in curves:
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        count = min(len(x), len(y))
        keep = slice(0, count, max(1, -(-count // MOST_POINTS)))
        x, y = x[keep], y[keep]
        finite = np.isfinite(x) & np.isfinite(y)
        drawn.append(Curve(name, x[finite], y[finite], not dots))
    return ClausePlot(x_label, y_label, tuple(drawn), limits)


def count_plot(label: str, wrong: NDArray[Any], each: str = "message") -> ClausePlot:
    """Return how many messages are wrong up to each of them: where in a recording a fault is.

    Parameters
    ----------
    label
        What is counted.
    wrong
        Of each message, whether it is wrong or how many of its parts are.
    each
        What follows each other along the axis.
    """
    counts = np.cumsum(wrong)
    return plot(each, f"{label} so far", (label, np.arange(len(counts)), counts))


def series_plot(
    label: str, values: NDArray[Any], limits: tuple[float, ...] = (), each: str = "message"
) -> ClausePlot:
    """Return a number of each message."""
    values = np.asarray(values)
    return plot(each, label, (label, np.arange(len(values)), values), limits=limits, dots=True)


def named_plot(
    label: str, values: Mapping[str, float], limits: tuple[float, ...] = ()
) -> ClausePlot:
    """Return a dot for each of a few numbers that have names."""
    y = np.array(list(values.values()), np.float64)
    drawn = plot("", label, (label, np.arange(len(y)), y), limits=limits, dots=True)
    return replace(drawn, names=tuple(values))


def steps_plot(label: str, values: NDArray[Any], most: int = 120) -> ClausePlot:
    """Return the distinct values in the middle, in their order: a coarse device shows stairs."""
    distinct = np.unique(values)
    start = max(0, (len(distinct) - most) // 2)
    return series_plot(label, distinct[start : start + most], each="rank of the distinct value")
