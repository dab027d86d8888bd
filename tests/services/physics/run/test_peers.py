# SPDX-License-Identifier: Apache-2.0
"""Commands of other processes on their way into an episode."""

from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.messages.base import encode, packed
from groundlink.messages.navigation import JointState
from groundlink.scenario.ros_side import FromRos, JointGroup
from services.physics.run.peers import Peers

NOTHING = memoryview(b"")
WHEEL = "front_left_wheel"


class ABus:
    """Hands over what is put into its subscriptions."""

    def __init__(self) -> None:
        self.inboxes: dict[str, Any] = {}

    def subscribe(self, key: str, message: type, inbox: Any) -> None:
        self.inboxes[key] = inbox, message

    def watch(self, key: str, take: Callable[[str, bool], None]) -> None:
        """Do nothing."""

    def put(self, key: str, message: JointState) -> None:
        inbox, message_type = self.inboxes[key]
        inbox.put(key, encode(message), message_type)


class AnEpisode:
    """Takes commands."""

    def __init__(self) -> None:
        self.commands: list[tuple[str, tuple[str, ...], str]] = []

    def command(self, vehicle: str, command: JointState, *, stream: str) -> bool:
        self.commands.append((vehicle, command.names, stream))
        return True

    def apply_acks(self) -> None:
        """Do nothing."""


def test_unknown_joints_are_counted_and_reported_once() -> None:
    scenario = load("indoor_lab")
    (rover,) = scenario.vehicles
    group = {"/v/commands": JointGroup(interface="velocity", joints=(WHEEL,))}
    rover = replace(rover, from_ros=FromRos(joint_groups=group))
    bus, episode = ABus(), AnEpisode()
    peers = Peers(bus, "lab")  # type: ignore[arg-type]
    peers.accept_commands(replace(scenario, vehicles=(rover,)))
    for names in ((WHEEL, "gripper"), (WHEEL,), ("gripper", WHEEL)):
        speeds = packed(np.ones(len(names)))
        command = JointState(0, "", names, NOTHING, speeds, NOTHING)
        bus.put("groundlink/lab/rover/command/joints", command)
    bus.put("groundlink/lab/rover/command/joints/v/commands", replace(command, names=(WHEEL, "x")))
    peers.deliver(episode)  # type: ignore[arg-type]
    assert [(vehicle, stream) for vehicle, _, stream in episode.commands] == [
        *[("rover", "joints")] * 3,
        ("rover", "joints/v/commands"),
    ]
    assert peers.counters()["unknown_joints"] == 3
    (line,) = peers.log_lines()
    assert line.startswith("rover: ignored commands of unknown joints (gripper); expected front_")
    assert peers.log_lines() == []
