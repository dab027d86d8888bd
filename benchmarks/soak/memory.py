# SPDX-License-Identifier: Apache-2.0
"""Whether the memory of a soak's ends is flat.

Rule: by the line nearest to what was measured behind the warm-up, of each end for itself.
"""

from __future__ import annotations

from typing import NamedTuple

WARM_UP = 0.3
"""Share of the time in which memory may grow: buffers are made when they are first needed."""
FLAT_KB_PER_MINUTE = 150.0
"""Of resident memory, by least squares over the rest of the time: 1 MB in 7 minutes, which is how
the allocator's heap moves up and down."""
JUDGED_MINUTES = 10.0
"""In a shorter soak the heap's steps look like a slope."""


class Sample(NamedTuple):
    """Resident memory of an end."""

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


def judged(memory: list[Sample], minutes: float) -> tuple[list[str], list[str]]:
    """Return a line about the memory of each end, and one about each that grows."""
    lines, growing = [], []
    for end in sorted({row.end for row in memory}):
        samples = [(row.seconds, row.kb) for row in memory if row.end == end]
        settled = [row for row in samples if row[0] >= WARM_UP * samples[-1][0]]
        slope = slope_kb_per_minute(settled)
        if minutes >= JUDGED_MINUTES and slope > FLAT_KB_PER_MINUTE:
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
