# SPDX-License-Identifier: Apache-2.0
"""One episode of a run: from tick zero of its physics to a reset, or to the end.

Rule: all that a reset begins anew is here and nothing else; who is on the bus stays.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from groundlink.bus.core_topics import GATEWAY, RECORDER
from groundlink.bus.topics import driver_names, process_names
from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS, Schedule
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack, Clock, Command, State, WheelCommand, decode, encode
from groundlink.messages.control import Remove, Spawn
from groundlink.messages.navigation import JointState
from groundlink.messages.vitals import VITALS_HZ
from groundlink.run.journal import (
    AnyEntry,
    Changed,
    Commanded,
    JointsCommanded,
    Journal,
    WheelsCommanded,
    encode_entry,
    state_digest,
    this_machine,
)
from groundlink.scenario import Scenario
from groundlink.scenario.change import with_more, without
from groundlink.scenario.lockstep_window import HISTORY_TICKS
from groundlink.world.build import solids, world_hash
from services.physics.simulation.simulation import Simulation

from .ground_truth import BodyTruth, VehicleTruth
from .pacer import pacer_for
from .participants import PendingAcks
from .publishers import Publishers

VITALS_TICKS = TICK_RATE_HZ // VITALS_HZ


class Episode:
    """A simulation, its time, and what others know of it.

    Parameters
    ----------
    others
        processes beside the sensors that a fast run waits for.
    wall_nanos
        the wall clock's, by which episodes are told apart.
    epoch_nanos
        of the run that this one takes up; none for one that begins.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        publish: Publishers,
        *,
        others: Sequence[str],
        wall_nanos: int,
        epoch_nanos: int | None = None,
    ) -> None:
        self._run, self.publish, self._others = run, publish, others
        self._at_start = self.scenario = scenario
        self.world_hash = world_hash(scenario)
        self.worlds = {self.world_hash: scenario}
        """All that there have been in this episode, by their hashes."""

        static = solids(scenario)
        self._simulation = Simulation(scenario, static)
        self._clock = Schedule.at(scenario.time.clock_rate_hz)
        self._next_clock = 0
        self._history: deque[bytes] = deque(maxlen=HISTORY_TICKS)
        self._entries: list[bytes] = []
        self._acks: dict[str, Ack] = {}
        self._predecessors: set[str] = set()
        self._cut_off: set[str] = set()
        self._truths = [VehicleTruth(vehicle) for vehicle in scenario.vehicles]
        self._bodies = BodyTruth(scenario, static)
        self._pending_acks = PendingAcks()
        self.number = wall_nanos
        if epoch_nanos is None:
            epoch_nanos = scenario.time.epoch_nanos
        self._follows_wall = epoch_nanos is None
        self.epoch_nanos = self.number if epoch_nanos is None else epoch_nanos
        self.pacer = pacer_for(scenario, self.number, others)

    @property
    def _is_realtime(self) -> bool:
        return self._at_start.time.mode == "realtime"

    @property
    def tick(self) -> int:
        """The last tick that was stepped to."""
        return self._simulation.tick

    def change(self, wish: Spawn | Remove) -> None:
        """Put something into the world or take it out, from the next state on.

        Raises
        ------
        UserError
            when that cannot be.
        """
        before, simulation = self.scenario, self._simulation
        match wish:
            case Spawn(more=more):
                seconds = self.tick * TICK_SECONDS
                scenario = with_more(before, more, simulation.moving(), seconds=seconds)
            case Remove(name=name):
                scenario = without(before, name)
        static = solids(scenario)
        simulation.become(scenario, static)
        self.scenario = scenario
        self.world_hash = world_hash(scenario)
        self.worlds[self.world_hash] = scenario
        self._bodies.change(scenario, static)
        told = {truth.vehicle: truth for truth in self._truths}
        self._truths = [
            told.get(v.name) or VehicleTruth(v, self.tick + 1) for v in scenario.vehicles
        ]
        self.pacer.participants.only((*process_names(scenario), RECORDER, *self._others))
        self._entries.append(encode_entry(Changed(self.tick, wish)))

    def left(self, process: str) -> None:
        """Take note that a process has gone, or its link.

        What it said last may be lost, and what it says next may come over another link. So where
        nothing is to be lost, it is not listened to before it has asked what it missed.
        """
        self.pacer.participants.left(process)
        if not self._is_realtime and (
            self.scenario.sensor(process) or process in driver_names(self.scenario)
        ):
            self._cut_off.add(process)

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Take note of how far a process has come, in this episode or an earlier one."""
        if ack.life == self.number and process not in self._cut_off:
            self._pending_acks.given(process, ack)

    def command(self, vehicle: str, command: Command | WheelCommand | JointState) -> bool:
        """Give a vehicle a command; return whether it will act, or is stale.

        Raises
        ------
        ValueError
            when it is none that a vehicle can obey.
        """
        stamp_nanos = command.stamp_nanos - self.epoch_nanos
        if isinstance(command, Command):
            velocity = replace(command, stamp_nanos=stamp_nanos)
            return self._take_in(Commanded(self.tick, vehicle, velocity))
        if isinstance(command, JointState):
            joints = replace(command, stamp_nanos=stamp_nanos)
            return self._take_in(JointsCommanded(self.tick, vehicle, joints))
        wheels = replace(command, stamp_nanos=stamp_nanos)
        return self._take_in(WheelsCommanded(self.tick, vehicle, wheels))

    def _take_in(self, entry: Commanded | WheelsCommanded | JointsCommanded) -> bool:
        if isinstance(entry, Commanded):
            # It is of these that drivers give their word.
            tick = entry.command.stamp_nanos // TICK_NANOS
            self._pending_acks.commanded(entry.vehicle, tick)
        elif isinstance(entry, JointsCommanded):
            tick = entry.command.stamp_nanos // TICK_NANOS
            self._pending_acks.commanded(f"{entry.vehicle}/joints", tick)
        will_act = self._simulation.command(entry.vehicle, entry.command)
        self._entries.append(encode_entry(entry))
        return will_act

    def follow(self, entry: AnyEntry) -> None:
        """Take in what an earlier episode has taken in at the same tick."""
        if isinstance(entry, Changed):
            self.change(entry.wish)
        else:
            self._take_in(entry)

    def journal(self, left_out: int = 0) -> Journal:
        """Return what it takes to have this episode again, without so many entries of its start.

        Raises
        ------
        UserError
            when it has not begun.
        """
        if not self._history:
            raise UserError("the run has not begun yet; it waits for its processes")
        return Journal(
            made_on=this_machine(),
            run=self._run,
            life=self.number,
            epoch_nanos=self.epoch_nanos,
            scenario=self._at_start,
            tick=self.tick,
            digest=state_digest(decode(self._history[-1], State)),
            entries=tuple(self._entries[left_out:]),
            left_out=left_out,
            acks=dict(self._acks),
        )

    def succeed(self, acks: Mapping[str, Ack]) -> None:
        """Carry over the acknowledgements of an earlier episode that had come to this tick."""
        self._acks = {name: replace(ack, life=self.number) for name, ack in acks.items()}
        self._predecessors = set(acks)

    def settle(self) -> None:
        """Count as said what was acknowledged, where the commands that go with it are here."""
        for process, ack in self._pending_acks.kept():
            self._acks[process] = ack
            self._predecessors.discard(process)
            self.pacer.participants.acknowledged(process, ack)

    def begin(self, wall_nanos: int, now_seconds: float) -> None:
        """Publish the first state; where nobody has been told the epoch yet, it is now.

        Building the world and joining the bus took a while: `wall_nanos` is the wall clock's time
        now, `now_seconds` that of the clock by which steps are paced.
        """
        if self._follows_wall and self._is_realtime:
            self.epoch_nanos = wall_nanos
        # This tick is now: whatever comes before the first step must not make all stamps older.
        self.pacer.hold()
        self.pacer.wait_seconds(self.tick, now_seconds)
        if self._history:
            # It was told, but to nobody.
            state = decode(self._history[-1], State)
            self._tell_time(state)
            self.publish.state(state)
        else:
            self._tell()

    def step(self) -> None:
        """Step one tick and publish what has become of the world."""
        self._simulation.step()
        self._tell()

    def _tell(self) -> None:
        """Publish the state of this tick, and before it all else that is due with it.

        Sensors answer to the state: who hears an answer has been sent all that physics had to say.
        """
        simulation, publish = self._simulation, self.publish
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
        if self._clock.tick(self._next_clock) <= simulation.tick:
            self._next_clock += 1
            self._tell_time(state)
        for truth in self._truths:
            if (due := truth.due(state)) is not None:
                stamp, vehicle = due
                torques = simulation.motor_torques(truth.vehicle)
                publish.truth[truth.vehicle](truth.odometry(vehicle, stamp))
                publish.wheels[truth.vehicle](truth.wheels(vehicle, torques, stamp))
                if len(vehicle.servo_positions):
                    publish.joints[truth.vehicle](truth.joints(vehicle, stamp))
        if bodies := self._bodies.poses(state):
            publish.bodies(bodies)
        if simulation.tick % VITALS_TICKS == 0:
            for vitals in simulation.vitals(state.stamp_nanos):
                publish.vitals[vitals.vehicle](vitals)
        self._history.append(publish.state(state))

    def _tell_time(self, state: State) -> None:
        self.publish.clock(Clock(state.stamp_nanos, self.epoch_nanos, state.tick, self.number))

    def missed_by(self, process: str) -> list[bytes]:
        """Return for a process that joins where it resumes, and the states since then.

        In real time there is nothing for who joins late, but for those that take up what they did
        in an earlier episode, for a gateway what the one before it knew, and for sensors that were
        there before. Where readings are left out these, too, have missed what they have missed.
        """
        if self._is_realtime and process not in self._predecessors:
            is_sensor = self.scenario.sensor(process) is not None
            if process not in self._acks or not (is_sensor or process == GATEWAY):
                return []
            if not self._at_start.time.waits or process == GATEWAY:
                return [encode(self._acks[process])]
        resume = self._acks.get(process, Ack(self.number, -1, -1))
        history = [*self._history]
        first_tick = self.tick + 1 - len(history)
        self._cut_off.discard(process)
        # What is settled it needs no more; all at once, sensors would ask for tens of megabytes.
        return [encode(resume), *history[max(resume.settled_tick - first_tick, 0) :]]

    def end(self) -> None:
        """Free the simulation."""
        self._simulation.close()
