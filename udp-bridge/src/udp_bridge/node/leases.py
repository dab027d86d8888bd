# SPDX-License-Identifier: Apache-2.0
"""What a peer asked for by Subscribe: until when, and how often. Time comes in as an argument.

Rule: a limit on the rate thins a stream out but never loses its last message, which may be the
one that says stop; so the newest is held until it is due. It knows neither ROS nor a socket.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Optional

if TYPE_CHECKING:
    from udp_bridge.wire.control import Subscribe

NANOS = 1_000_000_000
MAX_WAIT_NANOS = 100_000_000
"""How long to wait at most when nothing is known to come: a new wish may be there then."""


class Outgoing(NamedTuple):
    """A message on its way to a peer."""

    link: str
    stamp_nanos: Optional[int]
    """None where the message has none of its own: the time of sending stands for it."""
    body: bytes


class Lease:
    """One peer's wish for one topic: until when, how often, and what waits for its time."""

    def __init__(self) -> None:
        self.renewed_nanos = 0
        self._expires_nanos: Optional[int] = None
        self._period_nanos = 0
        self._due_nanos = 0
        self._held: Optional[Outgoing] = None

    def renew(self, subscribe: Subscribe, now_nanos: int) -> None:
        """Take over lease and rate."""
        self.renewed_nanos = now_nanos
        rate = subscribe.max_rate_hz
        self._period_nanos = int(NANOS / rate) if rate > 0 else 0
        lease_nanos = subscribe.lease_s * NANOS
        self._expires_nanos = now_nanos + lease_nanos if lease_nanos else None

    def is_over(self, now_nanos: int) -> bool:
        """Tell whether the lease has run out."""
        return self._expires_nanos is not None and now_nanos >= self._expires_nanos

    def offer(self, outgoing: Outgoing) -> None:
        """Take the newest message; it stays until it is due, so that the last is never lost."""
        self._held = outgoing

    def take(self, now_nanos: int) -> Optional[Outgoing]:
        """Return the message to send now, if there is one."""
        if self._held is None or now_nanos < self._due_nanos:
            return None
        outgoing, self._held = self._held, None
        self._due_nanos = now_nanos + self._period_nanos
        return outgoing

    def wait_nanos(self, now_nanos: int) -> int:
        """Return how long until `take` has something, if that is known."""
        if self._held is None:
            return MAX_WAIT_NANOS
        return max(0, self._due_nanos - now_nanos)
