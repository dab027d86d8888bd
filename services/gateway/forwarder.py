# SPDX-License-Identifier: Apache-2.0
"""How a gateway follows a run that does not wait for ROS; one that does is in `lockstep`.

Rule: what comes goes on at once; of what has piled up while this process was cut off or stood
still, only what is not stale. It tells how far it has come with each message of the clock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from groundlink.core.clock import NANOS, TICK_NANOS, Schedule
from groundlink.messages.base import Ack, Clock, Message, measured_nanos
from groundlink.scenario import Scenario

if TYPE_CHECKING:
    from groundlink.bus.inbox import BusInbox
    from udp_bridge.io.link import Link

    from .gateway import Gateway

FLUSH_SECONDS = 1.0
"""How long the link may take to send what waits before progress is told anyway."""

LISTEN_SECONDS = 0.05

PILE = 128
"""So many messages never wait where the gateway keeps up."""

STALE_NANOS = 3 * NANOS
"""What is this much behind the newest clock that has come is stale. As long as a router waits for
who takes nothing: a gateway that stands still for less makes up for it."""


class Forwarder:
    """Carries the streams of a run to ROS as they come.

    Parameters
    ----------
    acknowledge
        tells physics how far this has come.
    """

    def __init__(
        self,
        scenario: Scenario,
        gateway: Gateway,
        link: Link,
        *,
        acknowledge: Callable[[Ack], object],
    ) -> None:
        self._gateway, self._link, self._acknowledge = gateway, link, acknowledge
        # In real time the newest supersedes what waits; otherwise physics is held up.
        self._is_waited_for = scenario.time.mode != "realtime"
        self._clocks = Schedule.at(scenario.time.clock_rate_hz)
        self._life = 0
        self.tick = -1
        self._piled: deque[tuple[str, Message]] = deque()
        self._newest: Clock | None = None
        """Clock of what has piled up."""

        self.counts = {"clocks_missed": 0}

    def listen(self, inbox: BusInbox[Message]) -> tuple[str, Message] | None:
        """Return what has arrived from the bus, if anything does."""
        if not self._piled and len(inbox) > PILE and not self._is_waited_for:
            self._newest = None
            while len(inbox) and (arrived := inbox.get(seconds=0)):
                self._piled.append(arrived)
                if isinstance(arrived[1], Clock):
                    self._newest = arrived[1]
        return self._piled.popleft() if self._piled else inbox.get(seconds=LISTEN_SECONDS)

    def hear(self, key: str, message: Message) -> None:
        """Take a message of the bus."""
        if self._is_stale(message):
            self._gateway.counts["stale"] += 1
        elif key in self._gateway.streams:
            self._gateway.forward(key, message, self._link)
        if self._is_waited_for:
            self._link.flush(FLUSH_SECONDS)
        if isinstance(message, Clock):
            if message.life == self._life:
                self.counts["clocks_missed"] += self._clocks.between(self.tick, message.tick)
            self._life, self.tick = message.life, message.tick
            self._acknowledge(Ack(message.life, message.tick, message.tick))

    def _is_stale(self, message: Message) -> bool:
        """Return whether a message waited for long in what has piled up; one of the clock, too."""
        newest = self._newest
        if newest is None or newest.life != self._life:
            return False
        if newest.tick == self.tick:
            self._newest = None
        waited_nanos = (newest.tick - self.tick) * TICK_NANOS
        return min(waited_nanos, newest.stamp_nanos - measured_nanos(message)) > STALE_NANOS

    def turn(self, now_seconds: float) -> None:
        """Do nothing: nobody is waited for."""
