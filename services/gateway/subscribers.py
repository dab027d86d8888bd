# SPDX-License-Identifier: Apache-2.0
"""Subscribers of each topic: their leases and maximum rates.

The peer gets every pushed topic without a lease. Rates are limited by stamps, in simulation time.
"""

from dataclasses import dataclass, field

from groundlink.core.clock import NANOS
from udp_bridge.wire.control import Subscribe

Address = tuple[str, int]
TopicKey = tuple[int, str]
"""Wire type and ROS topic."""

MAX_RECEIVERS = 16
"""Addresses that may subscribe at a time. It bounds the traffic that forged requests can direct at
one host."""

IDLE_SECONDS = 10.0
"""An address that has not subscribed for so long may be replaced by another one."""

_NEVER = float("inf")


@dataclass
class _Lease:
    until_seconds: float
    period_nanos: int = 0
    is_pushed: bool = False
    """From the scenario: no Subscribe message ends or throttles it."""

    next_stamp_nanos: int = 0

    def admits(self, stamp_nanos: int) -> bool:
        """Return whether the message with this stamp is due, and record it."""
        if not self.period_nanos:
            return True
        reset = self.next_stamp_nanos - stamp_nanos > 2 * self.period_nanos
        if stamp_nanos < self.next_stamp_nanos and not reset:
            return False
        behind = stamp_nanos - self.next_stamp_nanos > self.period_nanos
        start = stamp_nanos if behind or reset else self.next_stamp_nanos
        self.next_stamp_nanos = start + self.period_nanos
        return True


@dataclass
class Subscribers:
    """The subscribers of every topic."""

    available: frozenset[TopicKey]
    """Topics that can be subscribed to."""

    _wanted: dict[TopicKey, dict[Address, _Lease]] = field(default_factory=dict)
    _requested_seconds: dict[Address, float] = field(default_factory=dict)
    """When each address sent its newest Subscribe message."""

    def push(self, topic: TopicKey, peer: Address) -> None:
        """Send a topic to the peer without a lease."""
        self._wanted.setdefault(topic, {})[peer] = _Lease(_NEVER, is_pushed=True)

    def request(self, sender: Address, topic: str, request: Subscribe, now_seconds: float) -> bool:
        """Handle a Subscribe message; return False if its topic or the table has no room for it."""
        key = (request.wanted_type, topic)
        if key not in self.available:
            return False
        receivers = self._wanted.setdefault(key, {})
        known = receivers.get(sender)
        if known is not None and known.is_pushed:
            return True
        if request.action == 0:
            receivers.pop(sender, None)
            if not any(sender in receivers for receivers in self._wanted.values()):
                self._requested_seconds.pop(sender, None)
            return True
        if sender not in self._requested_seconds and not self._has_room(now_seconds):
            return False
        self._requested_seconds[sender] = now_seconds
        until = now_seconds + request.lease_s if request.lease_s else _NEVER
        period = round(NANOS / request.max_rate_hz) if request.max_rate_hz else 0
        if known is None or known.period_nanos != period:
            known = receivers[sender] = _Lease(until, period)
        known.until_seconds = until
        return True

    def _has_room(self, now_seconds: float) -> bool:
        """Return whether another address may subscribe, after removing the longest idle one."""
        if len(self._requested_seconds) < MAX_RECEIVERS:
            return True
        idle = min(self._requested_seconds, key=self._requested_seconds.__getitem__)
        if now_seconds - self._requested_seconds[idle] < IDLE_SECONDS:
            return False
        del self._requested_seconds[idle]
        for receivers in self._wanted.values():
            known = receivers.get(idle)
            if known is not None and not known.is_pushed:
                del receivers[idle]
        return True

    def receivers(self, topic: TopicKey, stamp_nanos: int, now_seconds: float) -> list[Address]:
        """Return who gets the message of a topic with this stamp; remove expired leases."""
        receivers = self._wanted.get(topic, {})
        leases = list(receivers.items())  # a copy: another thread may add subscribers
        for sender, lease in leases:
            if lease.until_seconds < now_seconds:
                receivers.pop(sender, None)
        return [
            sender
            for sender, lease in leases
            if lease.until_seconds >= now_seconds and lease.admits(stamp_nanos)
        ]
