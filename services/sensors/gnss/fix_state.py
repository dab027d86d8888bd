# SPDX-License-Identifier: Apache-2.0
"""Fix state: which type of solution the received satellites give, by their number and lock times.

The lock of a satellite begins when its signal arrives, and begins anew when the signal is
interrupted, or changes between its direct and a reflected path. A solution is reached by the locks
that are old enough for it, and then uses every satellite whose lock is old enough for any solution.
Signals are examined at each fix, so an interruption between two fixes is not noticed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS, exact

from .dilution import Geometry, geometry
from .reception import Path, Signals
from .spec import Solution


class Solved(NamedTuple):
    """Type of solution at an instant, with the satellites in use."""

    rank: int
    """Index of the solution, from 0 for the worst."""

    used: NDArray[np.bool_]
    """Shape (satellites,)."""

    geometry: Geometry


class _Memory(msgspec.Struct, array_like=True):
    """Lock of each satellite."""

    path: list[int]
    since_nanos: list[int]


class FixState:
    """Lock times of all satellites, and the solution that they allow.

    Parameters
    ----------
    solutions
        From the worst to the best.
    satellites
        Number of satellites, received or not.
    """

    def __init__(self, solutions: Sequence[Solution], satellites: int) -> None:
        self._ranks = [
            (rank, solution, int(exact(solution.after_s) * NANOS))
            for rank, solution in enumerate(solutions)
        ]
        self._satellites = satellites
        self._has_memory = any(after for _, _, after in self._ranks)
        self._usable_after = min(after for _, _, after in self._ranks)
        self.restart()

    def restart(self) -> None:
        """Forget all locks."""
        self._path = np.full(self._satellites, Path.NONE, np.int64)
        self._since = np.zeros(self._satellites, np.int64)

    def memory(self) -> bytes:
        """Return the locks for a successor; empty if no solution depends on their age."""
        if not self._has_memory:
            return b""
        return msgspec.msgpack.encode(_Memory(self._path.tolist(), self._since.tolist()))

    def remember(self, memory: bytes) -> None:
        """Restore the result of an earlier `memory()`; empty memory is without locks."""
        self.restart()
        if memory:
            known = msgspec.msgpack.decode(memory, type=_Memory)
            self._path, self._since = np.array(known.path), np.array(known.since_nanos)

    def take(self, sim_nanos: int, signals: Signals) -> Solved | None:
        """Take the signals of the next fix; return the best solution, None without a position."""
        self._since = np.where(signals.path == self._path, self._since, sim_nanos)
        self._path = signals.path
        ages = sim_nanos - self._since
        usable = ages >= self._usable_after
        direct = usable & (signals.path == Path.DIRECT)
        received = usable & (signals.path != Path.NONE)
        for rank, solution, after in reversed(self._ranks):
            used = direct if solution.by_carrier else received
            if np.count_nonzero(used & (ages >= after)) >= solution.satellites:
                found = geometry(signals.towards, used)
                if found is not None:
                    return Solved(rank, used, found)
        return None
