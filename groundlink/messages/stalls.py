# SPDX-License-Identifier: Apache-2.0
"""Who held up a run and for how long, as physics tells it among its counters.

Rule: counters are whole numbers by name; which names stand for what is known here alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

_SILENT_NOW, _SILENT, _STRETCHED = "silent_now ", "silent_ms ", "stretched_ms "
"""Before a process's name. That of one that is silent now has 1."""

_BEHIND = "behind_ms"

_SHOWN_SECONDS = 0.05
"""Less is not shown in a line."""


@dataclass(frozen=True)
class Stalls:
    """What a run has been through."""

    silent_now: tuple[str, ...] = ()
    """Processes that have been waited for in vain for longer than the scenario's deadline."""

    silent_seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time, by process, of all such waits, from their begin; the present ones included."""

    stretched_seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time that the run has lost, caught up with since or not, by the process that was waited
    for, or physics where it was late by itself."""

    behind_seconds: float = 0.0
    """Wall time that the run has still to catch up with: so much are stamps behind the wall clock
    because of hold-ups."""

    def counters(self) -> dict[str, int]:
        """Return this as counters."""
        seconds = {
            _SILENT: self.silent_seconds,
            _STRETCHED: self.stretched_seconds,
            _BEHIND: {"": self.behind_seconds},
        }
        return {_SILENT_NOW + name: 1 for name in self.silent_now} | {
            prefix + name: round(1e3 * value)
            for prefix, by_name in seconds.items()
            for name, value in by_name.items()
            if round(1e3 * value)
        }

    @classmethod
    def read(cls, counters: Mapping[str, int]) -> Stalls:
        """Return what counters tell; of others than physics, nothing."""

        def seconds(prefix: str) -> dict[str, float]:
            return {
                name.removeprefix(prefix): count / 1e3
                for name, count in counters.items()
                if name.startswith(prefix)
            }

        behind = counters.get(_BEHIND, 0) / 1e3
        return cls(tuple(seconds(_SILENT_NOW)), seconds(_SILENT), seconds(_STRETCHED), behind)

    def __str__(self) -> str:
        """Return it in a line; empty where nothing was held up."""
        parts = []
        if self.silent_now:
            parts.append(f"silent: {', '.join(self.silent_now)}")
        if total := sum(self.stretched_seconds.values()):
            behind = f", {self.behind_seconds:.1f} s still to catch up"
            parts.append(
                f"time stretched by {total:.1f} s ({by_name(self.stretched_seconds)})"
                + (behind if self.behind_seconds >= _SHOWN_SECONDS else "")
            )
        return "; ".join(parts)


def by_name(seconds: Mapping[str, float]) -> str:
    """Return seconds by process, the longest first."""
    longest = sorted(seconds.items(), key=lambda item: -item[1])
    return ", ".join(f"{name} {value:.1f} s" for name, value in longest if value >= _SHOWN_SECONDS)
