# SPDX-License-Identifier: Apache-2.0
"""Check that the memory of both endpoints is flat, by a least-squares line after the warm-up."""

from typing import NamedTuple

WARM_UP = 0.3
"""Share of the time in which memory may grow, because buffers are allocated on first use."""
FLAT_KB_PER_MINUTE = 150.0
"""Largest accepted slope of resident memory: 1 MB in 7 minutes, the noise of the heap."""
MINIMUM_MINUTES = 10.0
"""In a shorter test the heap's steps look like a slope."""


class Sample(NamedTuple):
    """Resident memory of an endpoint."""

    end: str
    seconds: float
    kb: float


def slope_kb_per_minute(samples: list[tuple[float, float]]) -> float:
    """Return the slope of the line nearest to (seconds, kB), by least squares."""
    mean_s = sum(s for s, _ in samples) / len(samples)
    mean_kb = sum(kb for _, kb in samples) / len(samples)
    spread = sum((s - mean_s) ** 2 for s, _ in samples)
    if not spread:
        return 0.0
    return 60 * sum((s - mean_s) * (kb - mean_kb) for s, kb in samples) / spread


def check_memory(memory: list[Sample], minutes: float) -> tuple[list[str], list[str]]:
    """Return a line about the memory of each endpoint, and one about each that grows."""
    lines, growing = [], []
    for end in sorted({row.end for row in memory}):
        samples = [(row.seconds, row.kb) for row in memory if row.end == end]
        settled = [row for row in samples if row[0] >= WARM_UP * samples[-1][0]]
        slope = slope_kb_per_minute(settled)
        if minutes >= MINIMUM_MINUTES and slope > FLAT_KB_PER_MINUTE:
            growing.append(f"{end}: memory grows by {slope:.0f} kB a minute")
        sizes = [kb / 1024 for _, kb in settled]
        third = max(1, len(sizes) // 3)
        seconds = settled[-1][0] - settled[0][0]
        lines.append(
            f"memory of the {end}: {slope:+.1f} kB a minute over {seconds:.0f} s; "
            f"{min(sizes):.1f} to {max(sizes):.1f} MB, in the first third "
            f"{sum(sizes[:third]) / third:.2f} MB, in the last {sum(sizes[-third:]) / third:.2f} MB"
        )
    return lines, growing
