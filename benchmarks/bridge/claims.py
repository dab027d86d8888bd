# SPDX-License-Identifier: Apache-2.0
"""What the documents claim of the bridge, beside what was measured: ratios only, never times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

Row = Mapping[str, Any]
"""A line of a table, for machines."""


class Claim(NamedTuple):
    """A figure with its limit."""

    what: str
    value: float
    limit: float
    is_at_least: bool = True

    @property
    def holds(self) -> bool:
        """Whether the figure keeps to its limit."""
        return self.value >= self.limit if self.is_at_least else self.value <= self.limit

    def __str__(self) -> str:
        word = "at least" if self.is_at_least else "at most"
        verdict = "holds" if self.holds else "DOES NOT HOLD"
        return f"{verdict:13} {self.what}: {self.value:.2f}, claimed {word} {self.limit:g}"


class Part(NamedTuple):
    """What a part of the benchmark found."""

    rows: Sequence[Row]
    claims: Sequence[Claim]
