# SPDX-License-Identifier: Apache-2.0
"""States of a run that has none, as a replay or a file, made from its ground truth.

Vehicles move at the rate of their ground truth. Poses of all bodies come less often; between them a
wheel stays at its vehicle and turns as the ground truth says. Messages that take time to measure
wait for the ground truth of their end.
"""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from groundlink.core.clock import NANOS
from groundlink.core.frames import Floats, conjugate, matrix_from_quaternion, multiply
from groundlink.messages.base import (
    BusMessage,
    Clock,
    PointCloud,
    State,
    VehicleState,
    floats,
    measured_nanos,
    packed,
)
from groundlink.messages.ground_truth import Bodies
from groundlink.messages.imagery import LaserScan
from groundlink.messages.navigation import JointState, Odometry
from groundlink.ros.streams import Outgoing, RosStream
from groundlink.scenario import Scenario
from groundlink.scenario.joints import base_from_links
from groundlink.scenario.schema import Vehicle
from groundlink.scene.build import world_hash

HELD = 64
"""Messages that may wait for the ground truth of their end; beyond it the oldest are dropped."""

AHEAD_NANOS = 2 * NANOS
"""A message stamped further ahead of the clock is of the pass before, of a replay in a loop."""


class ReceivedMessage(NamedTuple):
    """A message of a stream of the run."""

    path: str
    stream: RosStream
    message: BusMessage


class StateReconstructor:
    """Makes states from ground truth."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self._scenario, self._run = scenario, run
        self._hash = world_hash(scenario)
        self._links = {v.name: _Links(v) for v in scenario.vehicles}
        self._rounds = 0
        self._clock: Clock | None = None
        self._begin()

    def _begin(self) -> None:
        self._actors = memoryview(b"")
        self._newest_nanos = -1
        self._held: deque[ReceivedMessage] = deque(maxlen=HELD)

    def follow(self, came: Iterable[ReceivedMessage]) -> tuple[list[State], list[ReceivedMessage]]:
        """Return the states made from messages, and the messages to draw after them."""
        vehicles: dict[int, dict[str, VehicleState]] = {}
        drawable: list[ReceivedMessage] = []
        received = list(came)
        for each in received:
            if isinstance(each.message, Clock):
                self._take_clock(each.message)
        if self._clock is None:
            return [], []
        last_nanos = self._clock.stamp_nanos + AHEAD_NANOS
        for each in received:
            message, (name, _, rest) = each.message, each.path.partition("/")
            if isinstance(each.stream, Outgoing) and measured_nanos(message) > last_nanos:
                continue
            if isinstance(message, Bodies):
                self._take_bodies(message)
            elif isinstance(message, JointState) and rest == "ground_truth/wheels":
                self._links[name].turn(floats(message.positions))
            elif isinstance(message, JointState) and rest == "ground_truth/joints":
                self._links[name].move(floats(message.positions))
            elif isinstance(message, Odometry) and rest == "ground_truth":
                at = vehicles.setdefault(message.stamp_nanos, {})
                at[name] = self._links[name].state(message)
            if isinstance(message, PointCloud | LaserScan) and isinstance(each.stream, Outgoing):
                self._held.append(each)
            else:
                drawable.append(each)
        states = [self._state(self._clock, stamp, vehicles[stamp]) for stamp in sorted(vehicles)]
        if states:
            self._newest_nanos = states[-1].stamp_nanos
        held, self._held = self._held, deque(maxlen=HELD)
        for each in held:
            (drawable if _end_nanos(each) <= self._newest_nanos else self._held).append(each)
        return states, drawable

    def _take_clock(self, clock: Clock) -> None:
        if self._clock is not None and clock.stamp_nanos < self._clock.stamp_nanos:
            self._rounds += 1  # a replay in a loop
            self._begin()
        self._clock = clock

    def _state(self, clock: Clock, stamp: int, vehicles: dict[str, VehicleState]) -> State:
        return State(
            *(self._run, clock.episode + self._rounds, clock.epoch_nanos, clock.tick),
            *(stamp - clock.epoch_nanos, self._hash, vehicles, self._actors),
        )

    def _take_bodies(self, bodies: Bodies) -> None:
        poses = dict(zip(bodies.names, bodies.world_from_body(), strict=True))
        for name, links in self._links.items():
            rows = [poses.get(f"{name}/{link}") for link in links.names]
            if all(row is not None for row in rows):
                links.place(np.array(rows))
        actors = [poses.get(actor.name) for actor in self._scenario.world.actors]
        if actors and all(row is not None for row in actors):
            self._actors = packed(np.array(actors))


class _Links:
    """Poses of the links of a vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        model = vehicle.model
        self.names = model.link_names()
        self.angles: Floats = np.zeros(len(model.wheels))
        """Newest true angles of the wheels."""

        self._placed_at: Floats = self.angles
        self._base_from_link = np.zeros((len(self.names), 7))
        self._base_from_link[:, 6] = 1.0
        wheels, last = [wheel.center_m for wheel in model.wheels], len(model.wheels) + 1
        self._base_from_link[1:last, :3] = wheels
        self._joints = model.joints
        self._base_from_joint = self._base_from_link[last:]
        self.move(np.zeros(len(model.joints)))

    def turn(self, angles: Floats) -> None:
        """Record the wheels' angles, if they fit this version's vehicle."""
        if len(angles) == len(self.angles):
            self.angles = angles

    def move(self, positions: Floats) -> None:
        """Move the links of joints other than wheels to positions, in rad or m.

        Positions of steering joints may follow; they are not drawn.
        """
        positions = positions[: len(self._joints)]
        if len(positions) == len(self._joints):
            for row, pose in enumerate(base_from_links(self._joints, positions.tolist())):
                self._base_from_joint[row] = *pose[0], *pose[1]

    def place(self, world_from_link: Floats) -> None:
        """Record the poses of all links at an instant, shape (links, 7), base first."""
        position, turn = world_from_link[0, :3], world_from_link[0, 3:]
        found = np.empty_like(world_from_link)
        found[:, :3] = (world_from_link[:, :3] - position) @ matrix_from_quaternion(turn)
        found[:, 3:] = multiply(conjugate(turn), world_from_link[:, 3:])
        self._base_from_link, self._placed_at = found, self.angles
        self._base_from_joint = found[len(self.angles) + 1 :]

    def state(self, truth: Odometry) -> VehicleState:
        """Return the state of the vehicle with its base at the true pose."""
        turned = self.angles - self._placed_at  # about the link's y
        spin = np.zeros((len(self.names), 4))
        spin[:, 3] = 1.0
        wheels = slice(1, len(turned) + 1)
        spin[wheels, 1], spin[wheels, 3] = np.sin(turned / 2), np.cos(turned / 2)
        rotation = matrix_from_quaternion(truth.orientation)
        poses = np.empty_like(self._base_from_link)
        poses[:, :3] = truth.position_m + self._base_from_link[:, :3] @ rotation.T
        poses[:, 3:] = multiply(truth.orientation, multiply(self._base_from_link[:, 3:], spin))
        velocity = np.concatenate([rotation @ truth.linear_mps, rotation @ truth.angular_radps])
        still = packed(np.zeros(len(self.angles)))
        return VehicleState(packed(poses), packed(velocity), packed(self.angles), still)


def _end_nanos(each: ReceivedMessage) -> int:
    """Return the end of the measurement of a message.

    The last laser of a revolution's last firing fires some microseconds after the revolution.
    """
    assert isinstance(each.stream, Outgoing)
    takes_s = 1 / each.stream.declared_hz
    if isinstance(each.message, PointCloud):
        takes_s = max(takes_s, float(each.message.records()["time"].max(initial=0.0)))
    return measured_nanos(each.message) + round(NANOS * takes_s)
