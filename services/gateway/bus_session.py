# SPDX-License-Identifier: Apache-2.0
"""The gateway's side of the bus: publishers, subscriptions and queries, each declared once.

It outlives the carriers, which are replaced when vehicles join or leave the run.
"""

import threading
from collections.abc import Callable
from functools import cached_property, partial
from typing import NamedTuple

from groundlink.bus.control_client import ask_world, send_command
from groundlink.bus.core_topics import (
    ACK,
    GATEWAY,
    HEALTH,
    PHYSICS,
    ROOT,
    STATE,
    Delivery,
    is_passed_locally,
)
from groundlink.bus.inbox import BusInbox
from groundlink.bus.local_inbox import LocalInbox
from groundlink.bus.queries import history_key, link_key
from groundlink.bus.session import Bus
from groundlink.messages.base import Ack, BusMessage, Clock, Health, State, decode
from groundlink.process.joining import Heartbeat, join
from groundlink.process.name_claim import NameClaim
from groundlink.scenario import Scenario

from .emulated_socket import EmulatedSocket
from .gateway import Gateway
from .request_queue import RequestQueue
from .run_commands import execute_run_command
from .world_queries import execute_world_query

HISTORY_SECONDS = 20.0
"""Timeout for the memory of a predecessor."""


class RunStatus(NamedTuple):
    """Where a run stands."""

    ack: Ack
    """The newest acknowledgement of a process."""

    state: State
    """The newest state of physics."""


class BusSession:
    """What a gateway has declared on the bus, and what it got from there.

    Parameters
    ----------
    depth
        messages of the bus that may wait.
    """

    def __init__(self, bus: Bus, run: str, claim: NameClaim, *, depth: int) -> None:
        self.bus, self.run, self._claim = bus, run, claim
        self.inbox: LocalInbox[BusMessage] = bus.local_inbox(depth=depth)
        self.acknowledge = bus.publisher(ACK.key_in(run, process=GATEWAY), ACK.delivery)
        self.run_commands = RequestQueue(
            partial(execute_run_command, partial(send_command, bus, run)), backlog=self.inbox
        )
        self.world_queries = RequestQueue(
            partial(execute_world_query, partial(ask_world, bus, run)), backlog=self.inbox
        )
        self.handed_over: tuple[int | None, bytes] = (None, b"")
        """Episode and memory of the last carrier."""

        self._publishers: dict[str, Callable[[BusMessage], bytes]] = {}
        self._emulated: EmulatedSocket | None = None
        self._types: dict[str, type[BusMessage]] = {}
        self._physics: BusInbox[Health] = BusInbox(depth=16)
        self._worlds: int | None = None
        bus.subscribe(HEALTH.key_in(run, process=PHYSICS), Health, self._physics)

    def close(self) -> None:
        """End the threads that execute requests of the peer."""
        self.run_commands.close()
        self.world_queries.close()

    @cached_property
    def heartbeat(self) -> Heartbeat:
        """The gateway's heartbeat. Access it only after all subscriptions are active."""
        return Heartbeat(self.bus, self.run, GATEWAY, self._claim)

    def declare(self, gateway: Gateway) -> None:
        """Declare publishers for what a gateway receives from ROS."""
        for each in gateway.subscriptions:
            if each.key not in self._publishers:
                self._publishers[each.key] = self.bus.publisher(each.key, Delivery.ALL)

    def publish(self, key: str, message: BusMessage) -> None:
        """Publish a message from ROS."""
        self._publishers[key](message)

    def subscribe(self, gateway: Gateway, scenario: Scenario, *, in_order: bool) -> None:
        """Subscribe to what a gateway sends to ROS.

        Parameters
        ----------
        in_order
            keep the order of all messages, and subscribe to acknowledgements of the sensors, too;
            to states of physics in a run without sensors.
        """
        if not in_order:
            for key, stream in gateway.streams.items():
                if key not in self._types:
                    self._types[key] = stream.message
                    is_local = is_passed_locally(
                        scenario.time.mode, stream.declared_hz, bulky=stream.bulky
                    )
                    if is_local:
                        self.bus.subscribe_local(key, stream.message, self.inbox)
                    else:
                        self.bus.subscribe(key, stream.message, self.inbox)
            return
        is_first = not self._types
        self._types |= {key: stream.message for key, stream in gateway.streams.items()}
        if not scenario.sensor_names():
            self._types[STATE.key_in(self.run)] = State
        if is_first:
            self.bus.subscribe_in_order(f"{ROOT}/{self.run}/**", self._type_of, self.inbox)

    def _type_of(self, key: str) -> type[BusMessage] | None:
        is_ack = key.startswith(ACK.key_in(self.run, process=""))
        return Ack if is_ack else self._types.get(key)

    def status(self, process: str = GATEWAY) -> RunStatus | None:
        """Return where the run stands for a process; None before its first state."""
        replies = list(self.bus.query(history_key(self.run), process, seconds=2.0).values())
        return (
            RunStatus(decode(replies[0], Ack), decode(replies[-1], State)) if replies[1:] else None
        )

    def memory_at(self, clock: Clock) -> bytes:
        """Return the memory of this gateway's predecessor, at the first clock of an episode."""
        episode, memory = self.handed_over
        if episode == clock.episode:
            return memory
        return predecessor_memory(self.bus, self.run) if clock.tick else b""

    def serve_link(self, emulated: EmulatedSocket) -> None:
        """Answer queries for the emulated link's settings, which may change them."""
        if self._emulated is None:
            self.bus.serve(link_key(self.run), self._answer)
        self._emulated = emulated

    def _answer(self, changes: str) -> list[bytes]:
        return self._emulated.answer(changes) if self._emulated is not None else []

    def changed(self, scenario: Scenario, stop: threading.Event) -> Scenario | None:
        """Return the run's scenario if it has other vehicles now.

        Physics is asked only after its health has reported another world.
        """
        worlds = self._worlds
        while len(self._physics) and (arrived := self._physics.get(seconds=0)):
            worlds = arrived[1].counters.get("worlds")
        if worlds == self._worlds:
            return None
        self._worlds = worlds
        _, now = join(self.bus, self.run, stop)
        return None if _names(now) == _names(scenario) else now


def predecessor_memory(bus: Bus, run: str) -> bytes:
    """Return the memory of the gateway process before this one; empty if there was none."""
    for payload in bus.query(history_key(run), GATEWAY, seconds=HISTORY_SECONDS).values():
        return decode(payload, Ack).memory
    return b""


def _names(scenario: Scenario) -> list[str]:
    return [vehicle.name for vehicle in scenario.vehicles]
