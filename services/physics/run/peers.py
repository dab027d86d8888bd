# SPDX-License-Identifier: Apache-2.0
"""Who else is in a run, and what they say to physics: commands, and how far they have come.

Rule: the bus brings it on its own threads and it waits here; the loop that steps takes it in
between two ticks.
"""

from __future__ import annotations

import queue
from collections.abc import Iterable

from groundlink.bus.core_topics import ACK, COMMAND, HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import JOINT_COMMAND, WHEEL_COMMAND
from groundlink.messages.base import Ack, Command, WheelCommand
from groundlink.messages.navigation import JointState
from groundlink.scenario import Scenario

from .episode import Episode


class Peers:
    """The other processes of a run.

    Attributes
    ----------
    refused : int
        Commands for what is not there or cannot obey.
    """

    def __init__(self, bus: Bus, run: str) -> None:
        self._bus, self._run = bus, run
        self._commands: BusInbox[Command | WheelCommand | JointState] = BusInbox(depth=1024)
        self._acks: BusInbox[Ack] = BusInbox(depth=1024)
        self._vehicles: dict[str, str] = {}
        self._gone: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._seen: frozenset[str] = frozenset()
        self._disobeyed = self._stale = 0
        self._ack_prefix = ACK.key_in(run, process="")
        self._health_prefix = HEALTH.key_in(run, process="")
        bus.subscribe(ACK.key_in(run), Ack, self._acks)
        bus.watch(HEALTH.key_in(run), self._on_liveliness)

    def obey(self, scenario: Scenario) -> None:
        """Take commands for a scenario's vehicles, where they are not taken yet."""
        for vehicle in scenario.vehicles:
            for row, message in (
                (COMMAND, Command),
                (WHEEL_COMMAND, WheelCommand),
                (JOINT_COMMAND, JointState),
            ):
                key = row.key_in(self._run, vehicle=vehicle.name)
                if key not in self._vehicles:
                    self._vehicles[key] = vehicle.name
                    self._bus.subscribe(key, message, self._commands)

    def lacks(self, wanted: Iterable[str]) -> frozenset[str]:
        """Return those of the wanted that have not been there yet."""
        return frozenset(wanted) - self._seen

    def tell(self, episode: Episode) -> None:
        """Have an episode take in what has been said, and who has left."""
        while not self._gone.empty():
            episode.left(self._gone.get())
        while len(self._acks) and (arrived := self._acks.get(seconds=0)):
            episode.acknowledged(arrived[0].removeprefix(self._ack_prefix), arrived[1])
        while len(self._commands) and (command := self._commands.get(seconds=0)):
            try:
                self._stale += not episode.command(self._vehicles[command[0]], command[1])
            except (ValueError, KeyError):  # such as for a vehicle that was taken away
                self._disobeyed += 1
        episode.settle()

    def wait(self, seconds: float) -> None:
        """Wait until somebody has come further, or so long."""
        self._acks.wait(seconds)

    def counters(self) -> dict[str, int]:
        """Return what did not get through."""
        refused = self._disobeyed + self._commands.refused + self._acks.refused
        return {
            "commands_dropped": self._commands.dropped,
            "commands_stale": self._stale,
            "refused": refused,
        }

    def _on_liveliness(self, key: str, there: bool) -> None:
        name = key.removeprefix(self._health_prefix)
        if there:
            self._seen |= {name}
        else:
            self._gone.put(name)
