# SPDX-License-Identifier: Apache-2.0
"""Peers: the other processes of a run, their commands and acknowledgements.

The bus delivers on its own threads; the loop that steps takes what has come between two ticks.
"""

import queue
from collections.abc import Iterable

from groundlink.bus.core_topics import ACK, COMMAND, HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import JOINT_COMMAND, JOINT_GROUP_COMMAND, WHEEL_COMMAND, joint_stream
from groundlink.messages.base import Ack, Command, WheelCommand
from groundlink.messages.navigation import JointState
from groundlink.scenario import Scenario

from .episode import Episode

COMMANDS = (COMMAND, Command), (WHEEL_COMMAND, WheelCommand), (JOINT_COMMAND, JointState)


class Peers:
    """The other processes of a run."""

    def __init__(self, bus: Bus, run: str) -> None:
        self._bus, self._run = bus, run
        self._commands: BusInbox[Command | WheelCommand | JointState] = BusInbox(depth=1024)
        self._acks: BusInbox[Ack] = BusInbox(depth=1024)
        self._vehicles: dict[str, str] = {}
        self._left: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._seen: frozenset[str] = frozenset()
        self._invalid = self._stale = self._unknown_joints = 0
        self._joints: dict[str, set[str]] = {}
        self._reported: set[str] = set()
        """Vehicles whose unknown joints have been reported."""

        self._log: list[str] = []
        self._ack_prefix = ACK.key_in(run, process="")
        self._health_prefix = HEALTH.key_in(run, process="")
        bus.subscribe(ACK.key_in(run), Ack, self._acks)
        bus.watch(HEALTH.key_in(run), self._on_liveliness)

    def accept_commands(self, scenario: Scenario) -> None:
        """Subscribe to the commands of a scenario's vehicles."""
        for vehicle in scenario.vehicles:
            self._joints[vehicle.name] = {joint.name for joint in vehicle.model.joint_interfaces()}
            keys = {
                topic.key_in(self._run, vehicle=vehicle.name): message
                for topic, message in COMMANDS
            }
            for topic in vehicle.from_ros.joint_groups:
                names = {"vehicle": vehicle.name, "topic": topic.strip("/")}
                keys[JOINT_GROUP_COMMAND.key_in(self._run, **names)] = JointState
            for key, message in keys.items():
                if key not in self._vehicles:
                    self._vehicles[key] = vehicle.name
                    self._bus.subscribe(key, message, self._commands)

    def not_seen(self, wanted: Iterable[str]) -> frozenset[str]:
        """Return those of the wanted processes that have not been there yet."""
        return frozenset(wanted) - self._seen

    def deliver(self, episode: Episode) -> None:
        """Give an episode all commands and acknowledgements that have come, and who has left."""
        while not self._left.empty():
            episode.process_left(self._left.get())
        while len(self._acks) and (arrived := self._acks.get(seconds=0)):
            episode.acknowledged(arrived[0].removeprefix(self._ack_prefix), arrived[1])
        while len(self._commands) and (command := self._commands.get(seconds=0)):
            try:
                self._stale += not self._command(episode, *command)
            except (ValueError, KeyError):  # such as for a vehicle that was removed
                self._invalid += 1
        episode.apply_acks()

    def _command(
        self, episode: Episode, key: str, command: Command | WheelCommand | JointState
    ) -> bool:
        vehicle = self._vehicles[key]
        if not isinstance(command, JointState):
            return episode.command(vehicle, command)
        strange = set(command.names) - self._joints[vehicle]
        self._unknown_joints += len(strange)
        if strange and vehicle not in self._reported:
            self._reported.add(vehicle)
            self._log.append(
                f"{vehicle}: ignored commands of unknown joints ({', '.join(sorted(strange))}); "
                f"expected {', '.join(sorted(self._joints[vehicle]))}"
            )
        return episode.command(vehicle, command, stream=joint_stream(key))

    def log_lines(self) -> list[str]:
        """Return the log lines since the last call."""
        lines, self._log = self._log, []
        return lines

    def wait(self, seconds: float) -> None:
        """Wait for an acknowledgement, or this long."""
        self._acks.wait(seconds)

    def counters(self) -> dict[str, int]:
        """Return the numbers of messages that had no effect."""
        return {
            "commands_dropped": self._commands.dropped,
            "commands_stale": self._stale,
            "unknown_joints": self._unknown_joints,
            "refused": self._invalid + self._commands.refused + self._acks.refused,
        }

    def _on_liveliness(self, key: str, there: bool) -> None:
        name = key.removeprefix(self._health_prefix)
        if there:
            self._seen |= {name}
        else:
            self._left.put(name)
