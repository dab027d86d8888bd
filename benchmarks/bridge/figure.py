# SPDX-License-Identifier: Apache-2.0
"""The paper's Figure 9 from what was measured here: time over size, one line a way."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def draw(
    file: Path, sizes: Sequence[int], names: Sequence[str], medians: Sequence[Sequence[float]]
) -> None:
    """Write a PNG.

    Parameters
    ----------
    sizes
        Bytes of the messages.
    medians
        Milliseconds, a row for each size, a column for each name.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.5))
    for column, name in enumerate(names):
        axes.plot([s / 1e6 for s in sizes], [row[column] for row in medians], "o-", label=name)
    axes.set(xscale="log", yscale="log", xlabel="message, MB", ylabel="ms until ROS's publish")
    axes.grid(True, which="major", alpha=0.4)
    axes.legend()
    figure.tight_layout()
    figure.savefig(file, dpi=150)
    pyplot.close(figure)
