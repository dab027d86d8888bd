# SPDX-License-Identifier: Apache-2.0
"""Driver: takes the states of a run and publishes commands, stamped ahead.

In fast mode every command arrives before the step in which it acts, and depends on states alone, so
that runs are reproducible; see `DRIVER_WINDOW_TICKS`. In real time, late commands act late.
"""

from collections.abc import Callable
from math import ceil

import msgspec
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS, exact
from groundlink.core.quaternions import heading_rad
from groundlink.messages.base import Ack, BadBusMessage, Command, State
from groundlink.scenario.route import COMMAND_AHEAD_TICKS, DRIVER_PERIOD_TICKS

from .pure_pursuit import Progress, PurePursuitFollower

MakePurePursuit = Callable[[float, float, float], PurePursuitFollower]
"""Makes a follower for a vehicle at x (m), y (m), yaw (rad)."""


class _Memory(msgspec.Struct, array_like=True):
    """State that a successor continues from."""

    start: tuple[float, float, float]
    """Pose of the vehicle at the start of the route: x (m), y (m), yaw (rad)."""

    progress: Progress
    commanded_tick: int
    start_tick: int = 0
    """Tick of the first state; the route starts after `wait_seconds`."""


class Driver:
    """Drives one vehicle.

    Parameters
    ----------
    make_follower
        called with the vehicle's pose at the first state of each episode.
    say
        prints a line for the user.
    wait_seconds
        simulation time for which the vehicle stands still before the route.
    """

    def __init__(
        self,
        vehicle: str,
        make_follower: MakePurePursuit,
        *,
        publish: Callable[[Command], object],
        acknowledge: Callable[[Ack], object],
        say: Callable[[str], object],
        wait_seconds: float = 0.0,
    ) -> None:
        self._vehicle = vehicle
        self._make_follower = make_follower
        self._publish = publish
        self._acknowledge = acknowledge
        self._say = say
        self._wait_ticks = ceil(exact(wait_seconds) * TICK_RATE_HZ)
        self._begin(None)
        self.commands = 0
        self.missed_ticks = 0
        self.refused = 0

    def _begin(self, episode: int | None) -> None:
        self._episode = episode
        self._start = (0.0, 0.0, 0.0)
        self._start_tick = 0
        self._follower: PurePursuitFollower | None = None
        self._commanded_tick = -1
        self._due = 0
        self.tick = self.acknowledged_tick = -1

    def resume(self, ack: Ack) -> None:
        """Continue after a predecessor: states that it has acknowledged are not handled again.

        Without a predecessor, acknowledge a period before the first state: physics then waits for
        no command of an earlier state.
        """
        self._begin(ack.episode)
        if ack.memory:
            known = msgspec.msgpack.decode(ack.memory, type=_Memory)
            self._start, self._start_tick = known.start, known.start_tick
            self._commanded_tick = known.commanded_tick
            self._follower = self._make_follower(*known.start)
            self._follower.progress = known.progress
            self.tick = self.acknowledged_tick = ack.tick
            self._due = _due_after(ack.tick)
            self._acknowledge(ack)
        else:
            self._acknowledge(replace(ack, tick=-DRIVER_PERIOD_TICKS))

    def take(self, state: State, waiting: int = 0) -> None:
        """Take a state; publish a command and an acknowledgement when they are due."""
        if state.episode != self._episode:
            self._begin(state.episode)
        elif state.tick <= self.tick:
            return
        elif self.tick >= 0:
            self.missed_ticks += state.tick - self.tick - 1
        self.tick = state.tick
        if state.tick < self._due:
            return
        self._due = _due_after(state.tick)
        try:
            follower = self._steer(state)
        except BadBusMessage:
            self.refused += 1
            return
        memory = _Memory(self._start, follower.progress, self._commanded_tick, self._start_tick)
        commanded = {self._vehicle: self._commanded_tick}
        self.acknowledged_tick = state.tick
        self._acknowledge(
            Ack(state.episode, state.tick, state.tick, msgspec.msgpack.encode(memory), commanded)
        )

    def _steer(self, state: State) -> PurePursuitFollower:
        """Publish the command for a state, until the end of the route."""
        if self._follower is not None and self._follower.finished:
            return self._follower
        vehicle = state.vehicles.get(self._vehicle)
        if vehicle is None or not len(vehicle.link_poses):
            raise BadBusMessage(f"the state lacks `{self._vehicle}`")
        x, y, _, qx, qy, qz, qw = vehicle.poses()[0].tolist()
        yaw = heading_rad((qx, qy, qz, qw))
        if self._follower is None:
            self._start, self._start_tick = (x, y, yaw), state.tick
            self._follower = self._make_follower(x, y, yaw)
        waits = state.tick < self._start_tick + self._wait_ticks
        linear, angular = (0.0, 0.0) if waits else self._follower.twist(x, y, yaw)
        self._commanded_tick = state.tick + COMMAND_AHEAD_TICKS
        stamp_nanos = state.epoch_nanos + self._commanded_tick * TICK_NANOS
        self._publish(Command(stamp_nanos, (linear, 0.0, 0.0), (0.0, 0.0, angular)))
        self.commands += 1
        if self._follower.finished:
            self._say(f"the route is driven; stopped at {state.tick * TICK_SECONDS:.1f} s")
        return self._follower


def _due_after(tick: int) -> int:
    """Return the next tick at which a command is due."""
    return (tick // DRIVER_PERIOD_TICKS + 1) * DRIVER_PERIOD_TICKS
