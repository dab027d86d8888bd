# SPDX-License-Identifier: Apache-2.0
"""One life of a run: from tick zero of its physics to a reset, or to the end.

Rule: all that a reset begins anew is here and nothing else; who is on the bus stays.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from msgspec.structs import replace

from groundlink.bus import Bus
from groundlink.clock import TICK_NANOS, TICK_RATE_HZ, Schedule
from groundlink.messages import Ack, Clock, Command, Message, State, WheelCommand, encode
from groundlink.scenario import Scenario
from groundlink.scenario.fast_fit import HISTORY_TICKS
from groundlink.scenario.route import DRIVER_WINDOW_TICKS
from groundlink.topics import (
    BODIES,
    CLOCK,
    GROUND_TRUTH,
    STATE,
    TRUE_WHEELS,
    VITALS,
    Topic,
    driver_name,
    driver_names,
)
from groundlink.vitals import VITALS_HZ
from groundlink.world.build import solids, world_hash
from groundlink.world.solids import Solid

from .pace import AsFastAsOthers, Promises, RealTime
from .simulation import Simulation
from .truth import BodyTruth, Truth

VITALS_TICKS = TICK_RATE_HZ // VITALS_HZ

Publish = Callable[[Message], bytes]


class Outlets(NamedTuple):
    """Where physics publishes: for the run, and for each vehicle by name."""

    state: Publish
    clock: Publish
    bodies: Publish
    truth: dict[str, Publish]
    wheels: dict[str, Publish]
    vitals: dict[str, Publish]


def outlets(bus: Bus, run: str, scenario: Scenario, known: Outlets | None = None) -> Outlets:
    """Declare all that physics publishes, but what is declared already."""

    def each(row: Topic, there: dict[str, Publish]) -> dict[str, Publish]:
        names = (vehicle.name for vehicle in scenario.vehicles)
        return {
            name: there.get(name) or bus.publisher(row.key_in(run, vehicle=name), row.delivery)
            for name in names
        }

    if known is None:
        state, clock, bodies = (
            bus.publisher(row.key_in(run), row.delivery) for row in (STATE, CLOCK, BODIES)
        )
        known = Outlets(state, clock, bodies, {}, {}, {})
    return known._replace(
        truth=each(GROUND_TRUTH, known.truth),
        wheels=each(TRUE_WHEELS, known.wheels),
        vitals=each(VITALS, known.vitals),
    )


class Life:
    """A simulation, its time, and what others know of it.

    Parameters
    ----------
    others
        processes beside the sensors that a fast run waits for.
    wall_nanos
        the wall clock's, by which lives are told apart.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        publish: Outlets,
        *,
        others: Sequence[str],
        wall_nanos: int,
    ) -> None:
        self._run, self._publish, self._others = run, publish, others
        self._follows_wall = scenario.time.epoch == "wall"
        self.world_hash = world_hash(scenario)
        static = solids(scenario)
        self._simulation = Simulation(scenario, static)
        self._clock = Schedule.at(scenario.time.clock_rate_hz)
        self._next_clock = 0
        self._history: deque[bytes] = deque(maxlen=HISTORY_TICKS)
        self._acks: dict[str, Ack] = {}
        self._truths = [Truth(vehicle) for vehicle in scenario.vehicles]
        self._bodies = BodyTruth(scenario, static)
        self._promises = Promises({driver_name(v): v.name for v in scenario.vehicles})
        self.number = wall_nanos
        self.epoch_nanos = self.number if self._follows_wall else 0
        self.pace = (
            RealTime(scenario.time.factor)
            if scenario.time.mode == "realtime"
            else AsFastAsOthers(
                dict.fromkeys((*scenario.sensor_names(), *others), scenario.time.window_ticks)
                | dict.fromkeys(driver_names(scenario), DRIVER_WINDOW_TICKS),
                scenario.time.window_ticks,
                self.number,
            )
        )

    @property
    def tick(self) -> int:
        """The last tick that was stepped to."""
        return self._simulation.tick

    def moving(self) -> list[Solid]:
        """Return what of vehicles and actors meets things, where they are now, in the world."""
        return self._simulation.moving()

    def become(self, scenario: Scenario, publish: Outlets) -> None:
        """Go on in a changed world, from the next state on; who joins gets none from before."""
        static = solids(scenario)
        self._simulation.become(scenario, static)
        self._publish = publish
        self.world_hash = world_hash(scenario)
        self._bodies.change(scenario, static)
        told = {truth.vehicle: truth for truth in self._truths}
        self._truths = [told.get(v.name) or Truth(v) for v in scenario.vehicles]
        self._promises.change({driver_name(v): v.name for v in scenario.vehicles})
        self.pace.only((*scenario.sensor_names(), *driver_names(scenario), *self._others))
        self._history.clear()

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Take note of how far a process has come, in this life or an earlier one."""
        if ack.life == self.number:
            self._acks[process] = ack
            self._promises.given(process, ack)

    def command(self, vehicle: str, command: Command | WheelCommand) -> None:
        """Give a vehicle a command.

        Raises
        ------
        ValueError
            when it is none that a vehicle can obey.
        """
        since_start = replace(command, stamp_nanos=command.stamp_nanos - self.epoch_nanos)
        if isinstance(command, Command):
            # It is of these that drivers give their word.
            self._promises.commanded(vehicle, since_start.stamp_nanos // TICK_NANOS)
        self._simulation.command(vehicle, since_start)

    def settle(self) -> None:
        """Count as said what was acknowledged, where the commands that go with it are here."""
        for process, ack in self._promises.kept():
            self.pace.acknowledged(process, ack)

    def begin(self, wall_nanos: int, now_seconds: float) -> None:
        """Publish the first state; where nobody has been told the epoch yet, it is now.

        Building the world and joining the bus took a while: `wall_nanos` is the wall clock's time
        now, `now_seconds` that of the clock by which steps are paced.
        """
        if self._follows_wall and isinstance(self.pace, RealTime):
            self.epoch_nanos = wall_nanos
        # Tick 0 is now: whatever comes before the first step must not make all stamps older.
        self.pace.wait_seconds(0, now_seconds)
        self._tell()

    def step(self) -> None:
        """Step one tick and publish what has become of the world."""
        self._simulation.step()
        self._tell()

    def _tell(self) -> None:
        """Publish the state of this tick, and all else that is due with it."""
        simulation, publish = self._simulation, self._publish
        state = State(
            self._run,
            self.number,
            self.epoch_nanos,
            simulation.tick,
            simulation.tick * TICK_NANOS,
            self.world_hash,
            simulation.vehicle_states(),
            simulation.actor_poses(),
        )
        self._history.append(publish.state(state))
        if self._clock.tick(self._next_clock) <= simulation.tick:
            self._next_clock += 1
            publish.clock(Clock(state.stamp_nanos, self.epoch_nanos, simulation.tick, self.number))
        for truth in self._truths:
            if (stamp := truth.due(state)) is not None:
                torques = simulation.motor_torques(truth.vehicle)
                publish.truth[truth.vehicle](truth.odometry(state, stamp))
                publish.wheels[truth.vehicle](truth.wheels(state, torques, stamp))
        if bodies := self._bodies.poses(state):
            publish.bodies(bodies)
        if simulation.tick % VITALS_TICKS == 0:
            for vitals in simulation.vitals(state.stamp_nanos):
                publish.vitals[vitals.vehicle](vitals)

    def missed_by(self, process: str) -> list[bytes]:
        """Return for a sensor that joins where it resumes, and the states since then.

        In real time nobody is waited for and what was missed is gone: the answer is empty.
        """
        if isinstance(self.pace, RealTime):
            return []
        resume = self._acks.get(process, Ack(self.number, -1, -1))
        return [encode(resume), *self._history.copy()]

    def end(self) -> None:
        """Free the simulation."""
        self._simulation.close()
