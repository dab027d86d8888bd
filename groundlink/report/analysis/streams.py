# SPDX-License-Identifier: Apache-2.0
"""Rates and gaps of a topic, from the times of its messages.

Memory does not grow with the run: counts in bins, sums, and the largest gaps.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.monitor.run_monitor import RATE_TOLERANCE

LARGEST_KEPT = 5

GAP_PERIODS = 1.5
"""Periods of the declared rate beyond which the time between messages is a gap."""

MAX_BINS = 600


@dataclass(frozen=True, order=True)
class StreamGap:
    """Time without a message."""

    nanos: int
    from_nanos: int
    """Stamp of the message before it."""


@dataclass(frozen=True)
class Bins:
    """A topic in bins of time."""

    edges_s: NDArray[np.float64]
    """Shape (N + 1,), seconds from the recording's first message."""

    kept: NDArray[np.bool_]
    """Shape (N,): as many messages came as are declared."""

    silent: NDArray[np.bool_]
    """Shape (N,): none came."""


class StreamTimes:
    """One topic's times.

    Parameters
    ----------
    first_nanos, last_nanos
        times of the recording's first and last message.
    """

    def __init__(
        self,
        topic: str,
        ros_type: str,
        declared_hz: float | None,
        *,
        first_nanos: int,
        last_nanos: int,
    ) -> None:
        self.topic = topic
        self.ros_type = ros_type
        self.declared_hz = declared_hz
        self.messages = 0
        self.bytes = 0
        self.gaps = 0
        """Number of gaps."""

        self._first_nanos, self._last_nanos = first_nanos, last_nanos
        self._bin_nanos = bin_nanos(last_nanos - first_nanos)
        bins = max(-(-(last_nanos - first_nanos) // self._bin_nanos), 1)
        self.counts: NDArray[np.int64] = np.zeros(bins, np.int64)
        """Messages in each bin of time."""

        self._begin = self._last = 0
        self._largest: list[StreamGap] = []

    def add(self, nanos: int, size_bytes: int) -> None:
        """Count a message."""
        if self.messages:
            gap = StreamGap(nanos - self._last, self._last)
            if self.declared_hz and gap.nanos > GAP_PERIODS * NANOS / self.declared_hz:
                self.gaps += 1
            if len(self._largest) < LARGEST_KEPT:
                heapq.heappush(self._largest, gap)
            elif gap > self._largest[0]:
                heapq.heapreplace(self._largest, gap)
        else:
            self._begin = nanos
        self.messages += 1
        self.bytes += size_bytes
        self._last = nanos
        self.counts[min((nanos - self._first_nanos) // self._bin_nanos, len(self.counts) - 1)] += 1

    @property
    def measured_hz(self) -> float | None:
        """Rate by stamps, from the first message to the last."""
        span = self._last - self._begin
        return (self.messages - 1) * NANOS / span if span > 0 else None

    @property
    def largest_gaps(self) -> list[StreamGap]:
        """The longest times between two messages, longest first."""
        return sorted(self._largest, reverse=True)

    def bins(self) -> Bins | None:
        """Return the state of each bin of time; None without a declared rate."""
        if not self.declared_hz:
            return None
        span = (self._last_nanos - self._first_nanos) / NANOS
        edges = np.minimum(np.arange(len(self.counts) + 1) * (self._bin_nanos / NANOS), span)
        expected = self.declared_hz * np.diff(edges)
        lack = np.abs(self.counts - expected)
        # Bins may hold one message more or less; the last bin includes both ends.
        kept = (lack < 1 - 1e-6) | (lack <= RATE_TOLERANCE * expected)
        kept[-1] |= lack[-1] < 1 + 1e-6
        return Bins(edges, kept, self.counts == 0)

    def unkept(self) -> list[tuple[float, float]]:
        """Return the spans of bins off the declared rate, in seconds."""
        found: list[tuple[float, float]] = []
        if (bins := self.bins()) is None:
            return found
        for i in np.flatnonzero(~bins.kept).tolist():
            begin, end = bins.edges_s[i : i + 2].tolist()
            if found and found[-1][1] == begin:
                begin, _ = found.pop()
            found.append((begin, end))
        return found


def bin_nanos(span_nanos: int) -> int:
    """Return the width of bins for a recording: whole seconds, and not more than `MAX_BINS`."""
    return max(-(-span_nanos // (MAX_BINS * NANOS)), 1) * NANOS
