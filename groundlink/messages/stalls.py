# SPDX-License-Identifier: Apache-2.0
"""Stalls of a run: which processes delayed it and for how long, as counters of physics.

Counters are integers by name. The names of stall counters are private to this module.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

_SILENT_NOW, _SILENT, _STRETCHED = "silent_now ", "silent_ms ", "stretched_ms "
"""Prefixes of the counters; a process name follows. The counter of a process that is silent now is
1."""

_BEHIND = "behind_ms"

_SHOWN_SECONDS = 0.05
"""Shorter times are left out of a line of text."""


@dataclass(frozen=True)
class Stalls:
    """Stalls of a run up to now."""

    silent_now: tuple[str, ...] = ()
    """Processes that physics has waited for longer than the scenario's `deadline_s`."""

    silent_seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time of all such waits by process, including current ones."""

    stretched_seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time by which each process delayed the run; physics itself can be one of them. Includes
    time that was recovered later."""

    behind_seconds: float = 0.0
    """Wall time that is still to be recovered: how far stamps lag the wall clock because of stalls.
    """

    def counters(self) -> dict[str, int]:
        """Return the stalls as counters."""
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
    def read(cls, counters: Mapping[str, int]) -> "Stalls":
        """Return the stalls from counters of physics; empty for counters of other processes."""

        def seconds(prefix: str) -> dict[str, float]:
            return {
                name.removeprefix(prefix): count / 1e3
                for name, count in counters.items()
                if name.startswith(prefix)
            }

        behind = counters.get(_BEHIND, 0) / 1e3
        return cls(tuple(seconds(_SILENT_NOW)), seconds(_SILENT), seconds(_STRETCHED), behind)

    def __str__(self) -> str:
        """Return the stalls as a line of text; empty without stalls."""
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
    """Return seconds by process as text, longest first."""
    longest = sorted(seconds.items(), key=lambda item: -item[1])
    return ", ".join(f"{name} {value:.1f} s" for name, value in longest if value >= _SHOWN_SECONDS)
