# SPDX-License-Identifier: Apache-2.0
"""What a receiver counts. `refused` and `duplicates` count datagrams, the rest whole messages."""

from __future__ import annotations

from typing import Any, Dict


class Counters:
    """Cumulative counts of what happened to everything that arrived or should have."""

    __slots__ = ("duplicates", "incomplete", "late", "messages", "missing", "refused", "repaired")

    def __init__(self) -> None:
        self.messages = 0
        """Messages handed over."""
        self.incomplete = 0
        """Messages given up before all their parts were in."""
        self.duplicates = 0
        """Datagrams of a part, or of a whole message, that had been there before."""
        self.late = 0
        """Whole messages that came behind a newer one and were not handed over."""
        self.missing = 0
        """Gaps in seq_number; an incomplete or late message was such a gap, too."""
        self.repaired = 0
        """Messages handed over that had lost parts, which came by repair."""
        self.refused: Dict[str, int] = {}
        """Forbidden datagrams by reason."""

    def refuse(self, reason: str) -> None:
        """Count one refused datagram."""
        self.refused[reason] = self.refused.get(reason, 0) + 1

    def as_dict(self) -> Dict[str, Any]:
        """Return all counts by name, `refused` as a dict of its own."""
        counts: Dict[str, Any] = {name: getattr(self, name) for name in _ORDER}
        counts["refused"] = dict(self.refused)
        return counts


_ORDER = ("messages", "incomplete", "duplicates", "late", "missing")
