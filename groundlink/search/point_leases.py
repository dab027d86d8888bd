# SPDX-License-Identifier: Apache-2.0
"""Points to evaluate, and who evaluates each: processes of this machine, and workers of others.

A worker names the points that it evaluates once in a while. A point that it does not name, or whose
worker is silent, is evaluated by someone else. The first outcome of a point counts; a later one is
the same, since runs are exact.
"""

from collections.abc import Collection, Iterable
from typing import Any

import msgspec

from .point_journal import PointOutcome, Values, key

LEASE_SECONDS = 10.0
"""A worker that is silent for so long has lost its points."""

EVALUATED_HERE = ""
"""Worker that is never silent: the processes of the search itself."""


class StartedPoint(msgspec.Struct, frozen=True):
    """A point that is to be evaluated."""

    stage: str
    number: int
    values: dict[str, Any]


class WorkerReport(msgspec.Struct, frozen=True):
    """What a worker tells the search, several times per second."""

    worker: str
    search: str
    """Search of its points, see `WorkerOrders`; empty before the first answer."""

    running: list[str]
    """Keys of the points that it evaluates."""

    outcomes: dict[str, PointOutcome]
    """Outcomes by key, until an answer has come."""

    free: int
    """Number of points that it can begin."""


class WorkerOrders(msgspec.Struct, frozen=True):
    """Answer to a report."""

    search: str
    """Identity of the search. Points of another one are of no use to it."""

    determined_by: dict[str, Any]
    """Options that determine the outcomes, by name."""

    start: dict[str, bytes] = {}
    """Requests of points to begin, by key."""


class PointLeases:
    """Points of a search from their start to their outcome."""

    def __init__(self) -> None:
        self._points: dict[str, StartedPoint] = {}
        """By key, in the order in which they were started."""

        self._holders: dict[str, str] = {}
        """Worker of each point that is or was evaluated, by key."""

        self._heard_s: dict[str, float] = {}
        """When each worker reported last."""

    def add(self, stage: str, number: int, values: Values) -> None:
        """Let a point be evaluated."""
        self._points.setdefault(key(values), StartedPoint(stage, number, dict(values)))

    def take(self, worker: str, most: int) -> dict[str, StartedPoint]:
        """Return points that nobody evaluates, the earliest first; the worker has them now."""
        free = [name for name in self._points if name not in self._holders][: max(most, 0)]
        self._holders |= dict.fromkeys(free, worker)
        return {name: self._points[name] for name in free}

    def heard(self, worker: str, running: Collection[str], now_s: float) -> bool:
        """Take note of the points that a worker evaluates; return whether it is a new worker."""
        is_new = worker not in self._heard_s
        self._heard_s[worker] = now_s
        self._free(name for name, holder in self._holders.items() if holder == worker)
        for name in running:
            if name in self._points:
                self._holders.setdefault(name, worker)
        return is_new

    def silent(self, now_s: float) -> list[str]:
        """Forget the workers that are silent for too long, and return their names."""
        gone = [name for name, at_s in self._heard_s.items() if now_s - at_s > LEASE_SECONDS]
        for worker in gone:
            del self._heard_s[worker]
        self._free(name for name, holder in self._holders.items() if holder in gone)
        return gone

    def finish(self, name: str) -> StartedPoint | None:
        """Return the point of an outcome, None if it has one already."""
        return self._points.pop(name, None)

    def _free(self, names: Iterable[str]) -> None:
        for name in list(names):
            del self._holders[name]
