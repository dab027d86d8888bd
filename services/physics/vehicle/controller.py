# SPDX-License-Identifier: Apache-2.0
"""Drive controller: turns commands into target speeds of driven shafts and steering angles.

Sim time comes in as an argument. A command acts in the first step at or after its stamp (plus the
motor's latency), until a newer one acts or it is older than the drive's timeout.
"""

from bisect import insort
from collections.abc import Sequence
from math import copysign, isfinite, radians
from typing import NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_SECONDS
from groundlink.messages.base import Command, WheelCommand
from groundlink.scenario.running_gear import Ackermann
from groundlink.scenario.vehicle import VehicleModel

from .joint_commands import CommandedJoints, JointsMemory, JointTargets
from .steering import STANDSTILL, Speeds, Twist, steering

MAX_WAITING = 1000
"""Commands that may wait for their stamp; more means that a sender's clock is wrong."""


class WheelTargets(NamedTuple):
    """Targets of shafts and steered wheels."""

    speeds_radps: Speeds
    """Of the driven shafts."""

    angles_rad: tuple[float, ...]
    """Of the steered wheels."""

    torques_nm: tuple[float | None, ...] = ()
    """Of the driven shafts: the largest torque toward the target speed; None, as without values,
    for that of the motor."""


class TargetsMemory(Struct, frozen=True, array_like=True):
    """What one command demands: one of these."""

    twist: Twist | None = None
    wheels: WheelTargets | None = None
    joints: JointTargets | None = None

    @classmethod
    def of(cls, asked: Twist | WheelTargets | JointTargets) -> "TargetsMemory":
        """Return targets as plain data."""
        if isinstance(asked, WheelTargets):
            return cls(wheels=asked)
        return cls(joints=asked) if isinstance(asked, JointTargets) else cls(twist=asked)

    @property
    def targets(self) -> Twist | WheelTargets | JointTargets:
        """The targets."""
        return self.wheels or self.joints or self.twist or STANDSTILL


class ControllerMemory(Struct, frozen=True, array_like=True):
    """Inner state of a `Controller`."""

    now_nanos: int
    since_nanos: int
    waiting: tuple[tuple[int, TargetsMemory], ...]
    """With their stamps, in sim time."""

    asked: TargetsMemory | None
    """None: the commands of `joints`."""

    joints: JointsMemory
    ramped: Twist | None
    wheels: WheelTargets

    def stamped_before(self, nanos: int) -> "ControllerMemory":
        """Return it without commands that have this stamp or a later one."""
        waiting = tuple(command for command in self.waiting if command[0] < nanos)
        return replace(self, waiting=waiting)


class Controller:
    """The drive controller of one vehicle.

    Parameters
    ----------
    epoch_nanos
        stamp of sim time zero.
    """

    def __init__(self, model: VehicleModel, *, epoch_nanos: int = 0) -> None:
        drive = model.drive
        self._drive = drive
        self._epoch_nanos = epoch_nanos
        self._timeout_nanos = round(drive.command_timeout_s * NANOS)
        self._latency_nanos = round(drive.motor.latency_s * NANOS) if drive.motor else 0
        self.steering = steering(model)
        self.shafts = tuple(s.name for s in drive.shafts(model.wheels) if s.driven)
        """Names of the driven shafts, in the order of their speeds."""

        self._steered = drive.steered if isinstance(drive, Ackermann) else ()
        self._range = radians(drive.max_steering_deg) if isinstance(drive, Ackermann) else 0.0
        self._linear_step = drive.max_acceleration_mps2 * TICK_SECONDS
        self._angular_step = drive.max_angular_acceleration_radps2 * TICK_SECONDS
        self._waiting: list[tuple[int, Twist | WheelTargets | JointTargets]] = []
        self._now_nanos = self._since_nanos = -1
        still = self._standstill = self.steering.STANDSTILL
        self._asked: Twist | WheelTargets | CommandedJoints = still
        self._joints = CommandedJoints(len(self.shafts), self._timeout_nanos)
        self._ramped: Twist | None = still
        self._wheels = WheelTargets(self.steering.speeds(still), self.steering.angles(still))

    def command(self, command: Command | WheelCommand) -> bool:
        """Take a command. One that is older than the active command changes nothing.

        Returns
        -------
        False for a stale command: its timeout was over when it came.

        Raises
        ------
        ValueError
            when a number is not finite, a wheel does not exist, or too many commands wait.
        """
        asked = (
            self._velocity(command) if isinstance(command, Command) else self._each_wheel(command)
        )
        return self._schedule(command.stamp_nanos, asked)

    def command_joints(self, stamp_nanos: int, targets: JointTargets) -> bool:
        """Take a command of single joints; see `command`.

        Joints that it leaves out keep their commands, each until the drive's timeout. A velocity
        command ends all of them.
        """
        return self._schedule(stamp_nanos, targets)

    def memory(self) -> ControllerMemory:
        """Return the inner state, but for that of the steering geometry."""
        asked = self._asked
        return ControllerMemory(
            now_nanos=self._now_nanos,
            since_nanos=self._since_nanos,
            waiting=tuple(
                (nanos - self._latency_nanos, TargetsMemory.of(targets))
                for nanos, targets in self._waiting
            ),
            asked=None if isinstance(asked, CommandedJoints) else TargetsMemory.of(asked),
            joints=self._joints.memory(),
            ramped=self._ramped,
            wheels=self._wheels,
        )

    def remember(self, memory: ControllerMemory) -> None:
        """Set the inner state."""
        self._now_nanos, self._since_nanos = memory.now_nanos, memory.since_nanos
        latency_nanos = self._latency_nanos
        self._waiting = [(nanos + latency_nanos, kept.targets) for nanos, kept in memory.waiting]
        self._joints.remember(memory.joints)
        asked = memory.asked.targets if memory.asked else self._joints
        assert not isinstance(asked, JointTargets), "`_joined` makes commanded joints of them"
        self._asked = asked
        self._ramped, self._wheels = memory.ramped, memory.wheels

    def _schedule(self, stamp_nanos: int, asked: Twist | WheelTargets | JointTargets) -> bool:
        sim_nanos = stamp_nanos - self._epoch_nanos + self._latency_nanos
        if self._now_nanos - sim_nanos > self._timeout_nanos:
            return False
        if len(self._waiting) >= MAX_WAITING:
            raise ValueError(f"{MAX_WAITING} commands already wait: their stamps are in the future")
        if sim_nanos >= self._since_nanos:
            insort(self._waiting, (sim_nanos, asked), key=lambda waiting: waiting[0])
        return True

    def _velocity(self, command: Command) -> Twist:
        if not all(map(isfinite, (*command.linear_mps, *command.angular_radps))):
            raise ValueError("a velocity is not finite")
        twist: Twist = (command.linear_mps[0], command.angular_radps[2])
        if len(self._standstill) > len(twist):
            twist = (*twist, command.linear_mps[1])
        return self.steering.within_limits(twist)

    def _each_wheel(self, command: WheelCommand) -> WheelTargets:
        most = self._drive.max_wheel_speed_radps
        speeds = _in_order(command.speeds_radps, self.shafts, most)
        return WheelTargets(speeds, _in_order(command.angles_rad, self._steered, self._range))

    def wheels(self, sim_nanos: int, angles: Sequence[float] = ()) -> WheelTargets:
        """Return the targets of shafts (rad/s) and steered wheels (rad) from `sim_nanos` on.

        To be called once a tick: a velocity changes within the drive's accelerations. Wheels that
        are commanded individually get their target speeds at once.

        Parameters
        ----------
        angles
            present angles of the steered wheels.
        """
        self._now_nanos = sim_nanos
        while self._waiting and self._waiting[0][0] <= sim_nanos:
            self._since_nanos, next_asked = self._waiting.pop(0)
            self._asked = (
                self._joined(next_asked) if isinstance(next_asked, JointTargets) else next_asked
            )
        asked = self._asked
        if isinstance(asked, CommandedJoints):
            return self._follow_joints(asked, sim_nanos, angles)
        if sim_nanos - self._since_nanos > self._timeout_nanos:
            asked = self._asked = self._standstill
        if isinstance(asked, WheelTargets):
            self._ramped, self._wheels = None, asked
        elif self._ramped != asked or angles:
            self._ramped = self._next_ramped(asked)
            twist = self.steering.within_limits(self._ramped)
            self._wheels = WheelTargets(
                self.steering.speeds(twist, angles), self.steering.angles(asked)
            )
        return self._wheels

    def _next_ramped(self, asked: Twist) -> Twist:
        """Return the velocity of this tick on the way to `asked`, within the accelerations."""
        now = self._ramped or self._standstill
        speed = _towards(now[0], asked[0], self._linear_step)
        turn = _towards(now[1], asked[1], self._angular_step)
        if len(asked) == 2:
            return speed, turn
        return speed, turn, _towards(now[2], asked[2], self._linear_step)

    def _joined(self, targets: JointTargets) -> CommandedJoints:
        """Return the commands of joints with these ones, which act now."""
        if not isinstance(self._asked, CommandedJoints):
            self._joints.begin(self._wheels.angles_rad)
        self._joints.take(targets, self._since_nanos)
        return self._joints

    def _follow_joints(
        self, joints: CommandedJoints, sim_nanos: int, angles: Sequence[float]
    ) -> WheelTargets:
        """Return the targets of commanded joints.

        The vehicle's velocity that the shaft speeds amount to has the same accelerations as a
        commanded one, and wheels roll as the present steering angles demand. What is left of a
        shaft's speed, since it contradicts the others, acts at once.
        """
        steering, most = self.steering, self._drive.max_wheel_speed_radps
        speeds, torques = joints.shafts(sim_nanos)
        asked = steering.twist(speeds, joints.angles_rad)
        self._ramped = self._next_ramped(asked)
        wanted = steering.speeds(asked, joints.angles_rad)
        now = steering.speeds(self._ramped, angles)
        self._wheels = WheelTargets(
            tuple(
                # A torque turns its shaft up to the largest speed.
                speed - agreed + ramped if torque is None else copysign(most, torque)
                for speed, torque, agreed, ramped in zip(speeds, torques, wanted, now, strict=True)
            ),
            tuple(joints.angles_rad),
            torques,
        )
        return self._wheels


def _in_order(given: dict[str, float], names: Sequence[str], most: float) -> tuple[float, ...]:
    """Return the values of all names, within limits; zero for a name that is missing."""
    if strange := given.keys() - set(names):
        raise ValueError(f"`{min(strange)}` takes no commands; expected one of {', '.join(names)}")
    if not all(map(isfinite, given.values())):
        raise ValueError("a value is not finite")
    return tuple(max(-most, min(most, given.get(name, 0.0))) for name in names)


def _towards(value: float, target: float, most: float) -> float:
    """Return `value` moved toward `target`, by at most `most`."""
    return value + max(-most, min(most, target - value))
