# SPDX-License-Identifier: Apache-2.0
"""Coverage of a search: which bins of each field its points have visited."""

from collections.abc import Iterable
from dataclasses import dataclass

from .space import Point, VariedField


@dataclass(frozen=True)
class FieldCoverage:
    """Points in the bins of one field."""

    field: VariedField
    counts: tuple[int, ...]
    """Number of points by bin."""

    @property
    def visited(self) -> int:
        """Number of bins with at least one point."""
        return sum(count > 0 for count in self.counts)

    @property
    def share(self) -> float:
        """Share of the bins with at least one point, 0 to 1."""
        return self.visited / len(self.counts)


def coverage(field: VariedField, points: Iterable[Point]) -> FieldCoverage:
    """Return the coverage of a field; points without the field or outside of it do not count."""
    counts = [0] * len(field.bins)
    for point in points:
        if field.name in point and (where := field.bin_of(point[field.name])) is not None:
            counts[where] += 1
    return FieldCoverage(field, tuple(counts))
