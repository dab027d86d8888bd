# SPDX-License-Identifier: Apache-2.0
"""Commands of joints by name: a JointState becomes targets of shafts, steering joints and servos.

A joint that a command leaves out, or for which it has NaN, keeps its last command. Shafts stop when
their last command is older than the drive's timeout; steering joints and servos hold their place.
"""

from collections.abc import Sequence
from math import isinf, isnan, radians
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from groundlink.messages.base import floats, packed
from groundlink.messages.navigation import JointState
from groundlink.scenario.running_gear import Ackermann
from groundlink.scenario.vehicle import VehicleModel

from .steering import Speeds


class JointTargets(NamedTuple):
    """Commanded joints of a drive, by index. Other joints keep their commands."""

    speeds_radps: dict[int, float]
    """Of the driven shafts."""

    torques_nm: dict[int, float]
    """Of the driven shafts; a shaft has a speed or a torque."""

    angles_rad: dict[int, float]
    """Of the steered wheels."""


class JointCommandReader:
    """Reads JointStates as commands of one vehicle."""

    def __init__(self, model: VehicleModel) -> None:
        self._commands = model.joint_interfaces()
        driven = (shaft.name for shaft in model.drive.shafts(model.wheels) if shaft.driven)
        self._shafts = {name: i for i, name in enumerate(driven)}
        self._steered = {name: i for i, name in enumerate(model.drive.steering_joints)}
        self._servos = frozenset(joint.name for joint in model.joints)
        self._most_radps = model.drive.max_wheel_speed_radps
        self._most_nm = model.drive.max_wheel_torque_nm
        drive = model.drive
        self._range = radians(drive.max_steering_deg) if isinstance(drive, Ackermann) else 0.0

    def read(self, command: JointState) -> tuple[JointTargets, JointState | None]:
        """Return the targets of the drive within its limits, and the command of the other joints.

        Names that the vehicle does not have are ignored.

        Raises
        ------
        ValueError
            when no joint of the vehicle is commanded, or a number is infinite.
        """
        positions, velocities, torques = (
            _by_name(command.names, values)
            for values in (command.positions, command.velocities, command.efforts)
        )
        targets = JointTargets({}, {}, {})
        servos: list[tuple[str, float, float]] = []
        for name in command.names:
            if (shaft := self._shafts.get(name)) is not None:
                if name in velocities:
                    targets.speeds_radps[shaft] = _within(velocities[name], self._most_radps)
                elif name in torques:
                    targets.torques_nm[shaft] = _within(torques[name], self._most_nm)
            elif name in positions:
                if (steered := self._steered.get(name)) is not None:
                    targets.angles_rad[steered] = _within(positions[name], self._range)
                elif name in self._servos:
                    servos.append((name, positions[name], velocities.get(name, 0.0)))
        if not any(targets) and not servos:
            expected = ", ".join(f"{name} ({commands[0]})" for name, commands in self._commands)
            if strange := set(command.names) - {name for name, _ in self._commands}:
                raise ValueError(f"no joint `{min(strange)}`; expected one of {expected}")
            raise ValueError(f"no joint gets a value; expected one of {expected}")
        return targets, _servo_command(command, servos) if servos else None


class JointsMemory(Struct, frozen=True, array_like=True):
    """Inner state of `CommandedJoints`."""

    speeds_radps: tuple[float, ...]
    torques_nm: tuple[float | None, ...]
    since_nanos: tuple[int, ...]
    angles_rad: tuple[float, ...]


class CommandedJoints:
    """The present commands of a drive's joints."""

    def __init__(self, shafts: int, timeout_nanos: int) -> None:
        self._shafts, self._timeout_nanos = shafts, timeout_nanos
        self.angles_rad: list[float] = []
        """Of the steered wheels."""

        self.begin(())

    def begin(self, angles_rad: Sequence[float]) -> None:
        """Forget all commands; steered wheels hold their angles."""
        self._speeds = [0.0] * self._shafts
        self._torques: list[float | None] = [None] * self._shafts
        self._since_nanos = [0] * self._shafts
        self.angles_rad = list(angles_rad)

    def memory(self) -> JointsMemory:
        """Return the inner state."""
        speeds, torques, since = self._speeds, self._torques, self._since_nanos
        return JointsMemory(tuple(speeds), tuple(torques), tuple(since), tuple(self.angles_rad))

    def remember(self, memory: JointsMemory) -> None:
        """Set the inner state."""
        self._speeds, self._torques = list(memory.speeds_radps), list(memory.torques_nm)
        self._since_nanos, self.angles_rad = list(memory.since_nanos), list(memory.angles_rad)

    def take(self, targets: JointTargets, sim_nanos: int) -> None:
        """Take commands that act from `sim_nanos` on."""
        for shaft, speed in targets.speeds_radps.items():
            self._speeds[shaft], self._torques[shaft] = speed, None
            self._since_nanos[shaft] = sim_nanos
        for shaft, torque in targets.torques_nm.items():
            self._speeds[shaft], self._torques[shaft] = 0.0, torque
            self._since_nanos[shaft] = sim_nanos
        for steered, angle in targets.angles_rad.items():
            self.angles_rad[steered] = angle

    def shafts(self, sim_nanos: int) -> tuple[Speeds, tuple[float | None, ...]]:
        """Return speed and torque of each shaft.

        The torque is None where a speed is commanded; the speed is 0 where a torque is.
        """
        for shaft, since in enumerate(self._since_nanos):
            if sim_nanos - since > self._timeout_nanos:
                self._speeds[shaft], self._torques[shaft] = 0.0, None
        return tuple(self._speeds), tuple(self._torques)


def _within(value: float, most: float) -> float:
    return max(-most, min(most, value))


def _by_name(names: Sequence[str], values: memoryview) -> dict[str, float]:
    """Return the values of a quantity by name, without NaN."""
    numbers: list[float] = floats(values).tolist()
    if any(map(isinf, numbers)):
        raise ValueError("a value is infinite")
    # A quantity that nobody commands has no values.
    return {n: number for n, number in zip(names, numbers, strict=False) if not isnan(number)}


def _servo_command(command: JointState, rows: Sequence[tuple[str, float, float]]) -> JointState:
    names, positions, speeds = zip(*rows, strict=True)
    return replace(
        command,
        names=names,
        positions=packed(np.array(positions)),
        velocities=packed(np.array(speeds)),
        efforts=memoryview(b""),
    )
