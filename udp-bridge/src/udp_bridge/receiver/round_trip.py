# SPDX-License-Identifier: Apache-2.0
"""Round-trip estimate of one topic, and the delays of requests that follow from it (RFC 6298)."""

from __future__ import annotations

from udp_bridge.wire.header import NANOS

DEBOUNCE_NANOS = 1_000_000
"""Delay from the detection of a gap to its request: datagrams may be reordered, and one request
covers several gaps. There is no delay for a message that an Offer announces as completely sent."""
DEBOUNCE_SHARE = 0.25
"""The delay is at most this share of a measured round trip, as in RFC 8985, 6.2: on a short path
datagrams are not reordered by much."""
FIRST_WAIT_NANOS = 50_000_000
"""Time from a request to its repetition before a round trip was measured."""
SHORTEST_WAIT_NANOS = 1_000_000
"""Minimum that is added to a measured round trip."""
LONGEST_WAIT_NANOS = NANOS // 2
BACK_OFF = 1.5
LONGEST_BACK_OFF = 3.0
"""Each repetition waits `BACK_OFF` times longer, up to `LONGEST_BACK_OFF` times the first wait."""


class RoundTrip:
    """Time from a request to the requested part: mean and deviation."""

    __slots__ = ("_deviation_nanos", "_nanos")

    def __init__(self) -> None:
        self._nanos = 0.0
        self._deviation_nanos = 0.0

    def add(self, nanos: int) -> None:
        """Add a measurement (RFC 6298, 2)."""
        if not self._nanos:
            self._nanos, self._deviation_nanos = nanos, nanos / 2
            return
        self._deviation_nanos += (abs(nanos - self._nanos) - self._deviation_nanos) / 4
        self._nanos += (nanos - self._nanos) / 8

    @property
    def nanos(self) -> int:
        """Mean; 0 before the first measurement."""
        return int(self._nanos)

    @property
    def upper_nanos(self) -> int:
        """Mean plus deviation; 0 before the first measurement."""
        return int(self._nanos + self._deviation_nanos)

    @property
    def debounce_nanos(self) -> int:
        """Delay from the detection of a gap to its request."""
        if not self._nanos:
            return DEBOUNCE_NANOS
        return min(DEBOUNCE_NANOS, int(self._nanos * DEBOUNCE_SHARE))

    def wait_nanos(self, tries: int) -> int:
        """Return the time until a request is repeated that was preceded by `tries` others."""
        wait: float = FIRST_WAIT_NANOS
        if self._nanos:
            wait = self._nanos + max(SHORTEST_WAIT_NANOS, 4 * self._deviation_nanos)
        return int(min(wait * min(BACK_OFF**tries, LONGEST_BACK_OFF), LONGEST_WAIT_NANOS))
