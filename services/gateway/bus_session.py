# SPDX-License-Identifier: Apache-2.0
"""What a gateway keeps while vehicles come into its run and go.

Rule: what is declared on the bus is declared once; whether there are other vehicles is asked when
physics says that the world has changed, and not before.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cached_property, partial
from typing import NamedTuple

from groundlink.bus.control_client import send_command
from groundlink.bus.core_topics import ACK, HEALTH, ROOT, STATE, Delivery
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import history_key, link_key
from groundlink.bus.session import Bus
from groundlink.messages.base import Ack, Health, Message, State, decode
from groundlink.process.joining import Heartbeat, join
from groundlink.process.name_claim import NameClaim
from groundlink.scenario import Scenario

from .emulated_socket import EmulatedSocket
from .gateway import Gateway
from .run_commands import RunCommandQueue

NAME = "gateway"

MESSAGES_KEPT = 4096
"""Messages of the bus that may wait: some seconds of all streams together."""


class RunStatus(NamedTuple):
    """Where a run stands."""

    ack: Ack
    """The newest acknowledgement of a process."""

    state: State
    """The newest state of physics."""


class BusSession:
    """What a gateway keeps of a run whose vehicles change: what it has declared on the bus."""

    def __init__(self, bus: Bus, run: str, claim: NameClaim) -> None:
        self.bus, self.run, self._claim = bus, run, claim
        self.inbox: BusInbox[Message] = BusInbox(depth=MESSAGES_KEPT)
        self.publishers: dict[str, Callable[[Message], bytes]] = {}
        self.acknowledge = bus.publisher(ACK.key_in(run, process=NAME), ACK.delivery)
        self.wishes = RunCommandQueue(
            partial(send_command, bus, run), backlog=lambda: len(self.inbox)
        )
        self.emulated: EmulatedSocket | None = None
        self.left: tuple[int | None, bytes] = (None, b"")
        """What the last gateway in this process left to the next: in which life, its memory."""

        self._types: dict[str, type[Message]] = {}
        self._physics: BusInbox[Health] = BusInbox(depth=16)
        self._worlds: int | None = None
        bus.subscribe(HEALTH.key_in(run, process="physics"), Health, self._physics)

    @cached_property
    def heartbeat(self) -> Heartbeat:
        """By which others know that it is there: to be asked for when it hears all."""
        return Heartbeat(self.bus, self.run, NAME, self._claim)

    def declare(self, gateway: Gateway) -> None:
        """Publish and subscribe what a gateway carries, where that is not done yet."""
        for wish in gateway.incoming:
            if wish.key not in self.publishers:
                self.publishers[wish.key] = self.bus.publisher(wish.key, Delivery.ALL)

    def subscribe(self, gateway: Gateway) -> None:
        """Hear what a gateway carries to ROS."""
        for key, stream in gateway.streams.items():
            if key not in self._types:
                self._types[key] = stream.message
                self.bus.subscribe(key, stream.message, self.inbox)

    def subscribe_in_order(self, gateway: Gateway, scenario: Scenario) -> None:
        """Hear that and how far sensors have come, or where there are none, physics; in order."""
        is_first = not self._types
        self._types |= {key: stream.message for key, stream in gateway.streams.items()}
        if not scenario.sensor_names():
            self._types[STATE.key_in(self.run)] = State
        if is_first:
            self.bus.subscribe_in_order(f"{ROOT}/{self.run}/**", self._type_of, self.inbox)

    def _type_of(self, key: str) -> type[Message] | None:
        is_ack = key.startswith(ACK.key_in(self.run, process=""))
        return Ack if is_ack else self._types.get(key)

    def resumed(self, process: str = NAME) -> RunStatus | None:
        """Return where the run is, as told to a process; None before its first state."""
        told = list(self.bus.query(history_key(self.run), process, seconds=2.0).values())
        return RunStatus(decode(told[0], Ack), decode(told[-1], State)) if told[1:] else None

    def emulates(self, emulated: EmulatedSocket) -> None:
        """Let the emulated link be changed and told by queries."""
        if self.emulated is None:
            self.bus.serve(link_key(self.run), self._answer)
        self.emulated = emulated

    def _answer(self, wish: str) -> list[bytes]:
        return self.emulated.answer(wish) if self.emulated is not None else []

    def changed(self, scenario: Scenario, stop: threading.Event) -> Scenario | None:
        """Return the run's scenario where other vehicles are in it now."""
        worlds = self._worlds
        while len(self._physics) and (arrived := self._physics.get(seconds=0)):
            worlds = arrived[1].counters.get("worlds")
        if worlds == self._worlds:
            return None
        self._worlds = worlds
        _, now = join(self.bus, self.run, stop)
        return None if _names(now) == _names(scenario) else now


def _names(scenario: Scenario) -> list[str]:
    return [vehicle.name for vehicle in scenario.vehicles]
