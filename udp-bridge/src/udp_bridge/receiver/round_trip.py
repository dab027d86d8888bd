# SPDX-License-Identifier: Apache-2.0
"""How long to wait before a gap is asked for, and before it is asked for again.

From the measured round trip (RFC 6298), of which nothing is known at first. What is asked for is
`resend_asking`'s.
"""

from __future__ import annotations

from udp_bridge.wire.header import NANOS

DEBOUNCE_NANOS = 1_000_000
"""A gap is this old before it is asked for: datagrams may overtake each other, and one request
serves several gaps. A message that is said to be sent altogether is not waited for."""
DEBOUNCE_SHARE = 0.25
"""It need not be older than this share of a measured round trip, as in RFC 8985, 6.2: on a short
way nothing overtakes by much."""
FIRST_WAIT_NANOS = 50_000_000
"""From a request to its repetition while no round trip was measured."""
SHORTEST_WAIT_NANOS = 1_000_000
"""What is added to a measured round trip at least."""
LONGEST_WAIT_NANOS = NANOS // 2
BACK_OFF = 1.5
LONGEST_BACK_OFF = 3.0
"""Each repetition waits this many times longer than the one before, up to so many round trips."""


class RoundTrip:
    """The time from a request to what was asked for, towards one sender."""

    __slots__ = ("_deviation_nanos", "_nanos")

    def __init__(self) -> None:
        self._nanos = 0.0
        self._deviation_nanos = 0.0

    def measured(self, nanos: int) -> None:
        """Take a measured time into the mean and its deviation (RFC 6298, 2)."""
        if not self._nanos:
            self._nanos, self._deviation_nanos = nanos, nanos / 2
            return
        self._deviation_nanos += (abs(nanos - self._nanos) - self._deviation_nanos) / 4
        self._nanos += (nanos - self._nanos) / 8

    @property
    def nanos(self) -> int:
        """Its mean; 0 while it is not known."""
        return int(self._nanos)

    @property
    def usual_nanos(self) -> int:
        """A time that most take no longer than; 0 while none is known."""
        return int(self._nanos + self._deviation_nanos)

    @property
    def debounce_nanos(self) -> int:
        """How old a gap is before it is asked for."""
        if not self._nanos:
            return DEBOUNCE_NANOS
        return min(DEBOUNCE_NANOS, int(self._nanos * DEBOUNCE_SHARE))

    def wait_nanos(self, tries: int) -> int:
        """Return the time from a request to the next, when there were `tries` before it."""
        wait: float = FIRST_WAIT_NANOS
        if self._nanos:
            wait = self._nanos + max(SHORTEST_WAIT_NANOS, 4 * self._deviation_nanos)
        return int(min(wait * min(BACK_OFF**tries, LONGEST_BACK_OFF), LONGEST_WAIT_NANOS))
