# SPDX-License-Identifier: Apache-2.0
"""Forwarder: sends the streams of a run that does not wait for ROS.

Messages are forwarded as they arrive. If many have piled up, because this process was disconnected
or suspended, stale ones are dropped. Clock messages are acknowledged to physics; where it waits, no
more of them than needed: the newest one when no message is left, and one each `ack_ticks`.
`lockstep` has the follower of runs that wait for ROS.
"""

from collections import deque
from collections.abc import Callable

from groundlink.bus.inbox import BusInbox
from groundlink.core.clock import NANOS, TICK_NANOS, Schedule
from groundlink.messages.base import Ack, BusMessage, Clock, measured_nanos
from groundlink.scenario import Scenario
from udp_bridge.io.link import Link

from .gateway import Gateway

FLUSH_SECONDS = 1.0
"""How long the link may take to send what waits before the clock is acknowledged anyway."""

LISTEN_SECONDS = 0.05

PILE_MESSAGES = 128
"""A gateway that keeps up never has so many waiting."""

STALE_NANOS = 3 * NANOS
"""Messages this much behind the newest clock are stale. A router waits as long for a receiver that
takes nothing, so a gateway that was suspended for less than that catches up."""


class Forwarder:
    """Sends the streams of a run to ROS as they arrive.

    Parameters
    ----------
    acknowledge
        publishes an acknowledgement to physics.
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
        # In real time new messages supersede waiting ones; otherwise physics waits.
        self._is_waited_for = scenario.time.mode != "realtime"
        self._clocks = Schedule.at(scenario.time.clock_rate_hz)
        self._ack_ticks = scenario.time.ack_ticks if self._is_waited_for else 0
        self._taken = self._acknowledged = Ack(-1, -1, -1)
        self._episode = 0
        self.tick = -1
        self._pile: deque[tuple[str, BusMessage]] = deque()
        self._newest: Clock | None = None
        """Newest clock in the pile."""

        self.counts = {"clocks_missed": 0}

    def listen(self, inbox: BusInbox[BusMessage]) -> tuple[str, BusMessage] | None:
        """Return the next message of the bus, if one arrives in time."""
        if not self._pile and not len(inbox):
            self._acknowledge_taken()
        if not self._pile and len(inbox) > PILE_MESSAGES and not self._is_waited_for:
            self._newest = None
            while len(inbox) and (arrived := inbox.get(seconds=0)):
                self._pile.append(arrived)
                if isinstance(arrived[1], Clock):
                    self._newest = arrived[1]
        return self._pile.popleft() if self._pile else inbox.get(seconds=LISTEN_SECONDS)

    def handle(self, key: str, message: BusMessage) -> None:
        """Handle a message of the bus."""
        if self._is_stale(message):
            self._gateway.counts["stale"] += 1
        elif key in self._gateway.streams:
            self._gateway.forward(key, message, self._link)
        if self._is_waited_for:
            self._link.flush(FLUSH_SECONDS)
        if isinstance(message, Clock):
            if message.episode == self._episode:
                self.counts["clocks_missed"] += self._clocks.between(self.tick, message.tick)
            self._episode, self.tick = message.episode, message.tick
            self._taken, known = (
                Ack(message.episode, message.tick, message.tick),
                self._acknowledged,
            )
            if message.episode != known.episode or message.tick >= known.tick + self._ack_ticks:
                self._acknowledge_taken()

    def _acknowledge_taken(self) -> None:
        """Acknowledge the newest clock message, unless that was done."""
        if self._taken is not self._acknowledged:
            self._acknowledged = self._taken
            self._acknowledge(self._taken)

    def _is_stale(self, message: BusMessage) -> bool:
        """Return whether a message, which may be a clock, has waited too long in the pile."""
        newest = self._newest
        if newest is None or newest.episode != self._episode:
            return False
        if newest.tick == self.tick:
            self._newest = None
        waited_nanos = (newest.tick - self.tick) * TICK_NANOS
        return min(waited_nanos, newest.stamp_nanos - measured_nanos(message)) > STALE_NANOS

    def turn(self, now_seconds: float) -> None:
        """Do nothing: only lockstep waits for ROS."""
