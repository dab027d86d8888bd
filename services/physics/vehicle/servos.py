# SPDX-License-Identifier: Apache-2.0
"""Servos of a vehicle's joints: move joints to commanded positions, tick by tick.

Sim time comes in as an argument. A command acts in the first step at or after its stamp, until a
newer one names the same joint. A joint moves at its `max_speed` or slower.
"""

from bisect import insort
from collections.abc import Sequence
from math import isfinite
from struct import Struct

import msgspec
from msgspec.structs import replace

from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.base import floats
from groundlink.messages.navigation import JointState
from groundlink.scenario.joints import Joint, Pose, base_from_links

from .controller import MAX_WAITING

Asked = dict[int, tuple[float, float]]
"""Target position and speed by the index of a joint."""


class ServosMemory(msgspec.Struct, frozen=True, array_like=True):
    """Inner state of `Servos`."""

    targets: tuple[tuple[float, float], ...]
    waiting: tuple[tuple[int, Asked], ...]
    moves: bool
    positions: tuple[float, ...]
    speeds: tuple[float, ...]

    def stamped_before(self, nanos: int) -> "ServosMemory":
        """Return it without commands that have this stamp or a later one."""
        waiting = tuple(command for command in self.waiting if command[0] < nanos)
        return replace(self, waiting=waiting)


class Servos:
    """The servos of one vehicle.

    Parameters
    ----------
    epoch_nanos
        stamp of sim time zero.
    """

    def __init__(self, joints: Sequence[Joint], *, epoch_nanos: int = 0) -> None:
        self._joints = joints
        self._epoch_nanos = epoch_nanos
        self._places = {joint.name: place for place, joint in enumerate(joints)}
        self._targets = [(0.0, joint.max_speed) for joint in joints]
        self._waiting: list[tuple[int, Asked]] = []
        self._moves = False
        self._pack = Struct(f"<{len(joints)}d").pack
        self.positions = [0.0] * len(joints)
        self.speeds = [0.0] * len(joints)
        self.poses: list[Pose] = []
        """Of the links, in the base frame."""

        self.state: tuple[memoryview, memoryview]
        """Positions and speeds, float64."""

        self._place()

    def command(self, command: JointState) -> bool:
        """Take a command: positions (rad, m), and optionally the speeds to move there.

        Raises
        ------
        ValueError
            when a joint does not exist, a position is missing, or a number is not finite.
        """
        positions = floats(command.positions).tolist()
        speeds = [abs(speed) for speed in floats(command.velocities).tolist()]
        if len(positions) != len(command.names):
            raise ValueError("joints without positions; expected one position for each name")
        if not all(map(isfinite, (*positions, *speeds))):
            raise ValueError("a position or velocity is not finite")
        if strange := set(command.names) - self._places.keys():
            known = ", ".join(self._places) or "none"
            raise ValueError(f"no joint `{min(strange)}` takes a command; expected one of {known}")
        if len(self._waiting) >= MAX_WAITING:
            raise ValueError(f"{MAX_WAITING} commands already wait: their stamps are in the future")
        asked: Asked = {}
        for i, (name, position) in enumerate(zip(command.names, positions, strict=True)):
            place = self._places[name]
            joint = self._joints[place]
            low, high = joint.limits
            # ROS publishers leave velocities out, or zero, where they give none.
            speed = min(speeds[i] if speeds and speeds[i] else joint.max_speed, joint.max_speed)
            asked[place] = min(max(position, low), high), speed
        stamp = command.stamp_nanos - self._epoch_nanos
        insort(self._waiting, (stamp, asked), key=lambda waiting: waiting[0])
        return True

    def memory(self) -> ServosMemory:
        """Return the inner state."""
        return ServosMemory(
            targets=tuple(self._targets),
            waiting=tuple(self._waiting),
            moves=self._moves,
            positions=tuple(self.positions),
            speeds=tuple(self.speeds),
        )

    def remember(self, memory: ServosMemory) -> None:
        """Set the inner state."""
        self._targets, self._waiting = list(memory.targets), list(memory.waiting)
        self._moves = memory.moves
        self.positions, self.speeds = list(memory.positions), list(memory.speeds)
        self._place()

    def step(self, sim_nanos: int) -> bool:
        """Advance by a tick from `sim_nanos`; return whether a joint may have moved."""
        while self._waiting and self._waiting[0][0] <= sim_nanos:
            self._moves = True
            for place, asked in self._waiting.pop(0)[1].items():
                self._targets[place] = asked
        if not self._moves:
            return False
        self._moves = False
        for i, (target, speed) in enumerate(self._targets):
            most = speed * TICK_SECONDS
            step = min(max(target - self.positions[i], -most), most)
            self.positions[i] += step
            self.speeds[i] = step / TICK_SECONDS
            self._moves = self._moves or step != 0.0
        self._place()
        return True

    def _place(self) -> None:
        """Update poses and state."""
        self.poses = base_from_links(self._joints, self.positions)
        packed = self._pack(*self.positions), self._pack(*self.speeds)
        self.state = memoryview(packed[0]), memoryview(packed[1])
