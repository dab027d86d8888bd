# SPDX-License-Identifier: Apache-2.0
"""The picture of a clause: curves or points over one axis, and limits as lines."""

from dataclasses import dataclass, field
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
