# SPDX-License-Identifier: Apache-2.0
"""Episode: a run from tick zero of its physics to a reset, or to its end.

All that a reset starts anew is here, and nothing else: processes and their connections stay.
"""

from collections import deque
from collections.abc import Mapping, Sequence

import msgspec
from msgspec import UNSET
from msgspec.structs import replace

from groundlink.bus.core_topics import GATEWAY, RECORDER
from groundlink.bus.topics import driver_names, process_names
from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS, Schedule
from groundlink.core.errors import UserError
from groundlink.episode.checkpoint import Checkpoint, period_ticks
from groundlink.episode.control import Move, Remove, Spawn, WorldChange
from groundlink.episode.journal import (
    AnyEntry,
    Commanded,
    Described,
    JointsCommanded,
    Journal,
    Placed,
    StateReset,
    WheelsCommanded,
    WorldChanged,
    encode_entry,
    state_digest,
    this_platform,
)
from groundlink.messages.base import (
    Ack,
    Clock,
    Command,
    EncodedState,
    State,
    WheelCommand,
    decode,
    encode,
    floats,
)
from groundlink.messages.ground_truth import VITALS_HZ
from groundlink.messages.navigation import JointState
from groundlink.scenario import Scenario
from groundlink.scenario.lockstep_window import HISTORY_TICKS
from groundlink.scene.build import solids, world_hash
from groundlink.scene.change import with_more, with_moved, without, without_parts
from groundlink.world.actors import EntityDescription
from groundlink.world.solids import Solid
from services.physics.dynamics.backend import Pose, Twist
from services.physics.simulation.simulation import Simulation, SimulationMemory
from services.physics.soil.ruts import PressedRuts, RutHistory

from .entities import NO_ENTITIES, EntityMemory, EntityRegistry
from .ground_truth import BodyTruth, VehicleTruth, map_truth
from .pacer import pacer_for
from .participants import CheckpointAcks, PendingAcks
from .publishers import Publishers

VITALS_TICKS = TICK_RATE_HZ // VITALS_HZ


class PhysicsMemory(msgspec.Struct, frozen=True, array_like=True):
    """Inner state of physics in a checkpoint."""

    simulation: SimulationMemory | None = None
    """None: of tick 0."""

    entities: EntityMemory = NO_ENTITIES


class Episode:
    """A simulation, its time, and what other processes know of it.

    Parameters
    ----------
    required
        processes besides the sensors that a fast run waits for.
    wall_nanos
        wall clock time, which identifies the episode.
    epoch_nanos
        epoch of the run that is continued; None: a new epoch.
    in_loaded_world
        whether the world was loaded into the run.
    checkpoint
        where it begins; None: at tick 0 of `scenario`.

    Attributes
    ----------
    worlds
        scenarios of all worlds of the episode, by their hashes.
    entities
        what is known of entities beside the scenario.
    rut_history
        recent ruts; None without soft terrain.
    """

    def __init__(
        self,
        scenario: Scenario,
        run: str,
        publish: Publishers,
        *,
        required: Sequence[str],
        wall_nanos: int,
        epoch_nanos: int | None = None,
        in_loaded_world: bool = False,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self._in_loaded_world = in_loaded_world
        self._run, self.publish, self._required = run, publish, required
        self._at_start, self._begins_at = scenario, checkpoint
        memory, tick = PhysicsMemory(), 0
        if checkpoint is not None:
            memory = msgspec.msgpack.decode(checkpoint.memory, type=PhysicsMemory)
            scenario = replace(checkpoint.scenario or scenario, time=scenario.time)
            tick = checkpoint.tick
        self.scenario = scenario
        self.world_hash = world_hash(scenario)
        self.worlds = {self.world_hash: scenario}
        self._static = static = solids(scenario)
        self._simulation = Simulation(scenario, static, memory=memory.simulation)
        self._clock = Schedule.at(scenario.time.clock_rate_hz)
        self._next_clock = self._clock.first_at_or_after(tick)
        self._clock_tick = self._clock.tick(self._next_clock)
        period_s = scenario.time.checkpoint_s
        self._checkpoint_ticks = None if period_s is None else period_ticks(period_s)
        self.checkpoints = CheckpointAcks()
        # Processes continue from acknowledgements that may be older than a period.
        kept = HISTORY_TICKS + 2 * (self._checkpoint_ticks or 0)
        self._history: deque[bytes] = deque(maxlen=kept)
        self.rut_history = RutHistory(self.ruts, kept) if self.ruts else None
        self._entries: list[bytes] = []
        self._acks: dict[str, Ack] = {}
        self._predecessors: set[str] = set()
        self._cut_off: set[str] = set()
        self._truths = [VehicleTruth(vehicle, tick) for vehicle in scenario.vehicles]
        self._bodies = BodyTruth(scenario, static, from_tick=tick)
        self._map = map_truth(scenario, static, from_tick=tick)
        self._expect_truth()
        self.entities = EntityRegistry(memory.entities)
        self._pending_acks = PendingAcks()
        self.number = wall_nanos
        if epoch_nanos is None:
            epoch_nanos = scenario.time.epoch_nanos
        self._follows_wall = epoch_nanos is None
        self.epoch_nanos = self.number if epoch_nanos is None else epoch_nanos
        self.pacer = pacer_for(self._at_start, self.number, required)
        if scenario is not self._at_start:
            self._only_present()

    @property
    def _is_realtime(self) -> bool:
        return self._at_start.time.mode == "realtime"

    @property
    def tick(self) -> int:
        """The tick of the present state."""
        return self._simulation.tick

    def change(self, command: WorldChange) -> None:
        """Add something to the world, remove or move it, from the next state on.

        Raises
        ------
        UserError
            when it cannot be added or moved, or is not there.
        """
        before, simulation = self.scenario, self._simulation
        match command:
            case Spawn(more=more):
                seconds = self.tick * TICK_SECONDS
                scenario = with_more(before, more, simulation.moving(), seconds=seconds)
            case Remove(name=name, parts=()):
                scenario = without(before, name)
            case Remove(name=name, parts=parts):
                scenario = without_parts(before, name, parts)
            case Move(name=name, solids=poses):
                scenario = with_moved(before, name, poses, simulation.moving())
        self._become(scenario)
        self.entities.changed(command, before, scenario)
        self._entries.append(encode_entry(WorldChanged(self.tick, command)))

    def _become(self, scenario: Scenario) -> None:
        """Simulate another world from the next step on; all that is in both continues."""
        simulation, static = self._simulation, solids(scenario)
        self._map.change(scenario, static)
        simulation.become(scenario, static)
        self.scenario, self._static = scenario, static
        self.world_hash = world_hash(scenario)
        self.worlds[self.world_hash] = scenario
        self._bodies.change(scenario, static)
        known = {truth.vehicle: truth for truth in self._truths}
        self._truths = [
            known.get(v.name) or VehicleTruth(v, self.tick + 1) for v in scenario.vehicles
        ]
        self._expect_truth()
        self._only_present()

    def _only_present(self) -> None:
        """Wait for no process of vehicles that are not in the world."""
        names = process_names(self.scenario)
        self.pacer.participants.only((*names, RECORDER, *self._required))

    def place(self, name: str, pose: Pose | None, twist: Twist | None) -> None:
        """Set pose or velocity of a vehicle or a free actor before the next step.

        Raises
        ------
        KeyError
            when there is neither of this name.
        """
        self._simulation.place(name, pose, twist)
        self._entries.append(encode_entry(Placed(self.tick, name, pose, twist)))

    def describe(self, name: str, description: EntityDescription | None) -> None:
        """Set what tools are told of an entity; None: what the scenario says."""
        self.entities.describe(name, description)
        self._entries.append(encode_entry(Described(self.tick, name, description)))

    def reset_state(self) -> None:
        """Put vehicles, free actors and moved solids back where they began, at rest."""
        if (scenario := self.entities.moved_back(self.scenario)) != self.scenario:
            self._become(scenario)
        self._simulation.reset_state(self.scenario)
        self._entries.append(encode_entry(StateReset(self.tick)))

    def motions(self) -> dict[str, tuple[Pose, Twist]]:
        """Return poses and velocities of vehicles and actors: of their origins, in the world."""
        return self._simulation.motions()

    def moving(self) -> list[Solid]:
        """Return the bodies of vehicles and actors where they are now, in the world frame."""
        return self._simulation.moving()

    def accelerations(self) -> dict[str, Twist]:
        """Return each vehicle's mean acceleration in the last tick: m/s2, rad/s2."""
        if len(self._history) < 2:
            return {}
        before, after = (decode(state, State).vehicles for state in (*self._history,)[-2:])
        found: dict[str, Twist] = {}
        for name in before.keys() & after.keys():
            change = floats(after[name].base_velocity) - floats(before[name].base_velocity)
            x, y, z, *turn = (change / TICK_SECONDS).tolist()
            found[name] = (x, y, z), (turn[0], turn[1], turn[2])
        return found

    def process_left(self, process: str) -> None:
        """Record that a process has left, or that its connection is lost.

        Its last acknowledgements may be lost, and its next ones may come over another connection.
        In lockstep, they do not count before the process has asked for what it missed.
        """
        self.pacer.participants.left(process)
        self.checkpoints.left(process)
        if not self._is_realtime and (
            self.scenario.sensor(process) or process in driver_names(self.scenario)
        ):
            self._cut_off.add(process)

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Take an acknowledgement, of this episode or an earlier one."""
        if ack.episode == self.number and process not in self._cut_off:
            self._pending_acks.add(process, ack)
            self.checkpoints.acknowledged(process, ack)

    def command(
        self,
        vehicle: str,
        command: Command | WheelCommand | JointState,
        *,
        stream: str = "joints",
    ) -> bool:
        """Give a vehicle a command; return False for a stale one, which does not act.

        Parameters
        ----------
        stream
            of a command of joints, as acknowledgements name it; see `joint_stream`.

        Raises
        ------
        ValueError
            when the command is invalid.
        """
        stamp_nanos = command.stamp_nanos - self.epoch_nanos
        if isinstance(command, Command):
            velocity = replace(command, stamp_nanos=stamp_nanos)
            return self._apply(Commanded(self.tick, vehicle, velocity))
        if isinstance(command, JointState):
            joints = replace(command, stamp_nanos=stamp_nanos)
            return self._apply(JointsCommanded(self.tick, vehicle, joints), stream)
        wheels = replace(command, stamp_nanos=stamp_nanos)
        return self._apply(WheelsCommanded(self.tick, vehicle, wheels))

    def _apply(
        self, entry: Commanded | WheelsCommanded | JointsCommanded, stream: str = "joints"
    ) -> bool:
        if isinstance(entry, Commanded):
            # Acknowledgements of drivers refer to these commands.
            tick = entry.command.stamp_nanos // TICK_NANOS
            self._pending_acks.commanded(entry.vehicle, tick)
        elif isinstance(entry, JointsCommanded):
            tick = entry.command.stamp_nanos // TICK_NANOS
            self._pending_acks.commanded(f"{entry.vehicle}/{stream}", tick)
        will_act = self._simulation.command(entry.vehicle, entry.command)
        self._entries.append(encode_entry(entry))
        return will_act

    def replay(self, entry: AnyEntry) -> None:
        """Apply a journal entry at its tick."""
        match entry:
            case WorldChanged(change=change):
                self.change(change)
            case Placed(name=name, pose=pose, twist=twist):
                self.place(name, pose, twist)
            case Described(name=name, description=description):
                self.describe(name, description)
            case StateReset():
                self.reset_state()
            case Commanded() | WheelsCommanded() | JointsCommanded():
                self._apply(entry)

    @property
    def ruts(self) -> PressedRuts | None:
        """The ruts of its terrain; None without soft terrain."""
        return self._simulation.ruts

    def journal(self, left_out: int = 0) -> Journal:
        """Return a journal to restore this episode from, without its first entries.

        Raises
        ------
        UserError
            when the episode has not begun.
        """
        if not self._history:
            raise UserError("the run has not begun: it is waiting for its processes")
        return Journal(
            made_on=this_platform(),
            run=self._run,
            episode=self.number,
            epoch_nanos=self.epoch_nanos,
            scenario=self._at_start,
            tick=self.tick,
            digest=state_digest(decode(self._history[-1], State)),
            entries=tuple(self._entries[left_out:]),
            left_out=left_out,
            acks=dict(self._acks),
            checkpoint=self._begins_at or UNSET,
            in_loaded_world=True if self._in_loaded_world else UNSET,
        )

    def take_over(self, acks: Mapping[str, Ack]) -> None:
        """Carry over the acknowledgements of an earlier episode that had come to this tick."""
        self._acks = {name: replace(ack, episode=self.number) for name, ack in acks.items()}
        self._predecessors = set(acks)
        for ack in acks.values():
            self._pending_acks.assume(ack)

    @property
    def awaits_commands(self) -> bool:
        """Whether acknowledgements have come whose commands have not."""
        return len(self._pending_acks) > 0

    def apply_acks(self) -> None:
        """Apply acknowledgements whose commands have come."""
        for process, ack in self._pending_acks.take_complete():
            self._acks[process] = ack
            self._predecessors.discard(process)
            self.pacer.participants.acknowledged(process, ack)

    def begin(self, wall_nanos: int, now_seconds: float) -> None:
        """Publish the first state; a real-time epoch that follows the wall clock is now.

        Parameters
        ----------
        wall_nanos
            wall clock time; building the world and joining the bus took a while.
        now_seconds
            time of the clock that paces steps.
        """
        if self._follows_wall and self._is_realtime:
            self.epoch_nanos = wall_nanos
        # This tick is due now: a delay before the first step must not make all stamps older.
        self.pacer.restart()
        self.pacer.wait_seconds(self.tick, now_seconds)
        if self._history:
            # It was published by silent publishers only.
            state = decode(self._history[-1], State)
            self._publish_clock(state.sim_nanos, state.tick)
            self.publish.state(state)
        else:
            self._publish_all()

    def step(self) -> None:
        """Step one tick and publish the new state."""
        self._simulation.step()
        if self._checkpoint_ticks is not None and self.tick % self._checkpoint_ticks == 0:
            self._make_checkpoint()
        self._publish_all()

    def _make_checkpoint(self) -> None:
        """Continue from a checkpoint of this tick as an episode does that begins with it."""
        simulation, scenario = self._simulation, self.scenario
        known = simulation.memory()
        if simulation.is_as_built:
            simulation.continue_from(known, scenario)
        else:
            simulation.close()
            self._simulation = Simulation(scenario, self._static, memory=known)
        memory = PhysicsMemory(known.stamped_before_tick(), self.entities.memory())
        checkpoint = Checkpoint(
            tick=self.tick,
            scenario=UNSET if scenario is self._at_start else scenario,
            memory=msgspec.msgpack.encode(memory),
            acks={},
        )
        self.checkpoints.add(checkpoint, self._acks.keys() - {RECORDER})

    def _publish_all(self) -> None:
        """Publish the state of this tick, after all else that is due with it.

        Sensors react to the state: when their reaction arrives, all other messages of the tick have
        been sent.
        """
        simulation, publish = self._simulation, self.publish
        tick = simulation.tick
        nanos = tick * TICK_NANOS
        header = self._run, self.number, self.epoch_nanos, tick, nanos, self.world_hash
        actors = simulation.actor_poses()
        if tick >= self._clock_tick:
            self._next_clock += 1
            self._clock_tick = self._clock.tick(self._next_clock)
            self._publish_clock(nanos, tick)
        if tick >= self._truth_tick:
            self._publish_truth(State(*header, simulation.vehicle_states(), actors))
        if tick % VITALS_TICKS == 0:
            for vitals in simulation.vitals(self.epoch_nanos + nanos):
                publish.vitals[vitals.vehicle](vitals)
        ruts = UNSET if self.ruts is None else self.ruts.at(tick)
        if self.rut_history is not None:
            self.rut_history.take(ruts)
        state = EncodedState(*header, msgspec.Raw(simulation.encoded_states()), actors, ruts)
        self._history.append(publish.state(state))

    def _publish_truth(self, state: State) -> None:
        """Publish what is due of the ground truth."""
        simulation, publish = self._simulation, self.publish
        for truth in self._truths:
            if (due := truth.due(state)) is not None:
                stamp, vehicle = due
                torques = simulation.motor_torques(truth.vehicle)
                publish.truth[truth.vehicle](truth.odometry(vehicle, stamp))
                publish.wheels[truth.vehicle](truth.wheels(vehicle, torques, stamp))
                if truth.joint_names:
                    steering = simulation.steering(truth.vehicle)
                    publish.joints[truth.vehicle](truth.joints(vehicle, steering, stamp))
        if bodies := self._bodies.poses(state):
            publish.bodies(bodies)
        if world_map := self._map.due(state):
            publish.true_map(world_map)
        self._expect_truth()

    def _expect_truth(self) -> None:
        """Find the tick of the next state that ground truth needs."""
        of_vehicles = (truth.next_tick for truth in self._truths)
        self._truth_tick = min(*of_vehicles, self._bodies.next_tick, self._map.next_tick)

    def _publish_clock(self, sim_nanos: int, tick: int) -> None:
        epoch_nanos = self.epoch_nanos
        self.publish.clock(Clock(epoch_nanos + sim_nanos, epoch_nanos, tick, self.number))

    def history_for(self, process: str) -> list[bytes]:
        """Return the acknowledgement where a joining process resumes, and the states since then.

        In real time a late process gets nothing, but: processes that take over from an earlier
        episode get it all, a gateway gets the last acknowledgement of the one before it, and so do
        sensors that were there before. Where readings are left out, sensors get no states either.
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
        # Without states that it has finished: together, sensors would fetch tens of megabytes.
        return [encode(resume), *history[max(resume.settled_tick - first_tick, 0) :]]

    def end(self) -> None:
        """Free the simulation."""
        self._simulation.close()
