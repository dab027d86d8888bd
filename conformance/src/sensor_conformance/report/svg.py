# SPDX-License-Identifier: Apache-2.0
"""Pictures as SVG, written without a library."""

from html import escape

import numpy as np

from .plot import ClausePlot, Floats

WIDTH, HEIGHT = 560, 220
LEFT, RIGHT, TOP, BOTTOM = 64, 12, 12, 40
MOST_NAMES = 12
"""Names below a picture; more would not be legible."""
COLORS = ("#00796b", "#e65100", "#3949ab")
"""Of the curves, in their order."""


def svg(drawn: ClausePlot) -> str:
    """Return a picture as an SVG element."""
    x = np.concatenate([curve.x for curve in drawn.curves])
    y = np.concatenate([curve.y for curve in drawn.curves])
    if not len(x):
        return ""
    low_x, high_x = _ends(x)
    low_y, high_y = _ends(np.concatenate((y, drawn.limits)))
    if drawn.names:
        # The first and the last dot stand inside the frame.
        low_x, high_x = -0.5, len(drawn.names) - 0.5

    def at_x(value: float) -> float:
        return LEFT + (value - low_x) / (high_x - low_x) * (WIDTH - LEFT - RIGHT)

    def at_y(value: float) -> float:
        return HEIGHT - BOTTOM - (value - low_y) / (high_y - low_y) * (HEIGHT - TOP - BOTTOM)

    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">']
    frame = f'x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" height="{HEIGHT - TOP - BOTTOM}"'
    parts.append(f'<rect class="frame" {frame}/>')
    for limit in drawn.limits:
        height = f"{at_y(limit):.1f}"
        line = f'x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{height}" y2="{height}"'
        parts.append(f'<line class="limit" {line}/>')
    for curve, color in zip(drawn.curves, COLORS, strict=False):
        points = [(at_x(a), at_y(b)) for a, b in zip(curve.x, curve.y, strict=True)]
        if curve.is_line:
            text = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
            parts.append(f'<polyline points="{text}" stroke="{color}"/>')
        else:
            text = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in points)
            parts.append(f'<path class="dots" d="{text}" stroke="{color}"/>')
    for value, row in ((low_y, HEIGHT - BOTTOM), (high_y, TOP + 10)):
        parts.append(f'<text x="{LEFT - 4}" y="{row}" text-anchor="end">{value:.4g}</text>')
    for index, name in enumerate(drawn.names[:MOST_NAMES]):
        # Long names of neighbors would overlap in one row.
        place = f'x="{at_x(index):.0f}" y="{HEIGHT - BOTTOM + 14 + 12 * (index % 2)}"'
        parts.append(f'<text {place} text-anchor="middle">{escape(name)}</text>')
    for value, anchor in () if drawn.names else ((low_x, "start"), (high_x, "end")):
        place = f'x="{at_x(value):.0f}" y="{HEIGHT - BOTTOM + 14}"'
        parts.append(f'<text {place} text-anchor="{anchor}">{value:.4g}</text>')
    middle = f'x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 8}" text-anchor="middle"'
    parts.append(f"<text {middle}>{escape(drawn.x_label)}</text>")
    upright = f'transform="translate(12 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)"'
    parts.append(f'<text {upright} text-anchor="middle">{escape(drawn.y_label)}</text>')
    if len(drawn.curves) > 1:
        for row, (curve, color) in enumerate(zip(drawn.curves, COLORS, strict=False)):
            place = f'x="{WIDTH - RIGHT - 6}" y="{TOP + 14 + 14 * row}" text-anchor="end"'
            parts.append(f'<text {place} fill="{color}">{escape(curve.name)}</text>')
    parts.append("</svg>")
    return "".join(parts)


def _ends(values: Floats) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    if low == high:
        return low - 1, high + 1
    return low, high
