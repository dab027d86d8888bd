# SPDX-License-Identifier: Apache-2.0
"""Plotted values, collected and passed to Rerun some times a second.

A sample costs an append; one call to Rerun carries all values since the last call.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr

TIMELINE = "sim_time"

XYZ = ("x", "y", "z")
XYZ_COLORS = ((238, 84, 84), (108, 204, 96), (84, 148, 250))

LINE_COLORS = (
    *((84, 168, 255), (255, 170, 60), (120, 214, 120), (240, 110, 170)),
    *((180, 140, 255), (70, 214, 214), (230, 220, 100), (200, 200, 200)),
)


class Plots:
    """The lines of all plots of a recording."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._waiting: dict[str, tuple[list[int], list[Sequence[float]]]] = {}
        self._named: set[str] = set()

    def add(
        self,
        path: str,
        sim_nanos: int,
        values: Sequence[float],
        names: Sequence[str],
        colors: Sequence[tuple[int, int, int]] = LINE_COLORS,
    ) -> None:
        """Add one value to each of the lines of an entity."""
        if path not in self._named:
            self._named.add(path)
            chosen = [colors[i % len(colors)] for i in range(len(names))]
            lines = rr.SeriesLines(names=list(names), colors=chosen, widths=[1.5] * len(names))
            self._recording.log(path, lines, static=True)
        times, rows = self._waiting.setdefault(path, ([], []))
        times.append(sim_nanos)
        rows.append(values)

    def flush(self) -> None:
        """Pass all waiting values to Rerun."""
        for path, (times, rows) in self._waiting.items():
            self._recording.send_columns(
                path,
                indexes=[rr.TimeColumn(TIMELINE, duration=np.array(times, "m8[ns]"))],
                columns=rr.Scalars.columns(scalars=np.array(rows, np.float64)),
            )
        self._waiting.clear()
