# SPDX-License-Identifier: Apache-2.0
"""The paper's Figure 9 from what was measured here: time over size, one line a way."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .result import Row

_LABELS = {
    "UDP Bridge": "UDP Bridge, from send",
    "from the bus": "UDP Bridge, from the sensor's publish on the bus",
    "C program": "C program, until the message is whole",
    "ROS# way": "ROS# way (rosbridge's calls, read by the leanest server)",
    "rosbridge": "the same calls, read by rosbridge itself",
}


def draw(file: Path, rows: Sequence[Row]) -> None:
    """Write a PNG; `rows` are those of `latency`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.5))
    for name in rows[0]["ms"]:
        megabytes, took = [r["bytes"] / 1e6 for r in rows], [r["ms"][name] for r in rows]
        axes.plot(megabytes, took, "o-", label=_LABELS.get(name, name))
    axes.set(xscale="log", yscale="log", xlabel="message, MB", ylabel="ms until ROS's publish call")
    axes.grid(True, which="major", alpha=0.4)
    axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file, dpi=150)
    pyplot.close(figure)
