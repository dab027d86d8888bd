# SPDX-License-Identifier: Apache-2.0
"""Who gets which topic, and how often.

Rule: the peer gets every pushed topic for ever; anybody gets what it has subscribed to until its
lease ends. Time comes in as an argument. Rates are limited by stamps, so that sim time counts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from groundlink.core.clock import NANOS
from udp_bridge.wire.control import Subscribe

Address = tuple[str, int]
TopicKey = tuple[int, str]
"""Wire type and ROS topic."""

MAX_RECEIVERS = 16
"""Addresses that may subscribe at a time: who forges the address of the peer's host has at most so
many times the streams sent there."""

IDLE_SECONDS = 10.0
"""An address that has not subscribed for so long gives its place to another one."""

_FOR_EVER = float("inf")


@dataclass
class _Lease:
    until_seconds: float
    period_nanos: int = 0
    is_pushed: bool = False
    """By the scenario: no Subscribe ends or throttles it."""

    next_stamp_nanos: int = 0

    def admits(self, stamp_nanos: int) -> bool:
        """Return whether the message with this stamp is wanted, and take note of it."""
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
    """The receivers of every topic."""

    available: frozenset[TopicKey]
    """What may be subscribed to."""

    _wanted: dict[TopicKey, dict[Address, _Lease]] = field(default_factory=dict)
    _asked_seconds: dict[Address, float] = field(default_factory=dict)
    """When each address sent its newest Subscribe."""

    def push(self, topic: TopicKey, peer: Address) -> None:
        """Send a topic to the peer for ever, unasked."""
        self._wanted.setdefault(topic, {})[peer] = _Lease(_FOR_EVER, is_pushed=True)

    def request(self, sender: Address, topic: str, request: Subscribe, now_seconds: float) -> bool:
        """Do what a Subscribe says; return False when it asks for what there is not."""
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
                self._asked_seconds.pop(sender, None)
            return True
        if sender not in self._asked_seconds and not self._has_place(now_seconds):
            return False
        self._asked_seconds[sender] = now_seconds
        until = now_seconds + request.lease_s if request.lease_s else _FOR_EVER
        period = round(NANOS / request.max_rate_hz) if request.max_rate_hz else 0
        if known is None or known.period_nanos != period:
            known = receivers[sender] = _Lease(until, period)
        known.until_seconds = until
        return True

    def _has_place(self, now_seconds: float) -> bool:
        """Return whether another address may subscribe; the one that is idle longest may go."""
        if len(self._asked_seconds) < MAX_RECEIVERS:
            return True
        idle = min(self._asked_seconds, key=self._asked_seconds.__getitem__)
        if now_seconds - self._asked_seconds[idle] < IDLE_SECONDS:
            return False
        del self._asked_seconds[idle]
        for receivers in self._wanted.values():
            known = receivers.get(idle)
            if known is not None and not known.is_pushed:
                del receivers[idle]
        return True

    def receivers(self, topic: TopicKey, stamp_nanos: int, now_seconds: float) -> list[Address]:
        """Return who gets the message of a topic with this stamp; forget leases that ended."""
        receivers = self._wanted.get(topic, {})
        wishes = list(receivers.items())  # a copy: another thread subscribes meanwhile
        for sender, wish in wishes:
            if wish.until_seconds < now_seconds:
                receivers.pop(sender, None)
        return [
            sender
            for sender, wish in wishes
            if wish.until_seconds >= now_seconds and wish.admits(stamp_nanos)
        ]
