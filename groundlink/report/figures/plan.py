# SPDX-License-Identifier: Apache-2.0
"""Plan of the world as a figure: obstacles and contour lines of the ground."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from groundlink.report.analysis.plan import SolidOutline
from groundlink.world.terrain import Ground

from .svg_theme import BODY, FURNITURE, GRAY, MUTED, WALL

TALL_M = 1.6
"""Higher solids are drawn as walls."""

HEIGHTS = 160
"""Samples of the terrain along each side."""

LEAST_HEIGHT_M = 0.01
"""Flatter ground has no contour lines."""


def plan(plot: Axes, outlines: Sequence[SolidOutline]) -> None:
    """Draw outlines from above."""
    for outline in outlines:
        tall = outline.high_m > TALL_M
        plot.add_patch(
            Polygon(
                outline.corners_m,
                facecolor=WALL if tall else FURNITURE,
                edgecolor=BODY,
                linewidth=0.5,
                alpha=1.0 if tall or outline.low_m < 0.1 else 0.75,
            )
        )


def heights(
    plot: Axes, ground: Ground, low: NDArray[np.float64], high: NDArray[np.float64]
) -> None:
    """Draw contour lines of the visible ground."""
    x, y = (np.linspace(low[i], high[i], HEIGHTS) for i in range(2))
    z = ground.height_at(*np.meshgrid(x, y))
    known = z[np.isfinite(z)]
    if len(known) and np.ptp(known) > LEAST_HEIGHT_M:
        drawn = plot.contour(x, y, z, levels=9, colors=GRAY, linewidths=0.7, zorder=0.5)
        plot.clabel(drawn, fontsize=7.5, fmt="%g m", colors=MUTED)
