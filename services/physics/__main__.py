# SPDX-License-Identifier: Apache-2.0
"""The physics process: steps the world, tells everybody its state, serves what replicas need.

Rule: the only process that reads the scenario's files and the only one that says what tick it is.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

import msgspec
from msgspec.structs import replace

from groundlink import process
from groundlink.bus import DEFAULT_ENDPOINT, Bus
from groundlink.clock import TICK_NANOS, TICK_RATE_HZ, Schedule
from groundlink.errors import UserError
from groundlink.inbox import Inbox
from groundlink.messages import Ack, Clock, Command, State, encode
from groundlink.scenario import Scenario, load
from groundlink.scenario.explain import nearest
from groundlink.scenario.route import DRIVER_WINDOW_TICKS
from groundlink.topics import (
    ACK,
    BODIES,
    CLOCK,
    COMMAND,
    GROUND_TRUTH,
    HEALTH,
    STATE,
    TRUE_WHEELS,
    VITALS,
    driver_name,
    driver_names,
    history_key,
    scenario_key,
)
from groundlink.vitals import VITALS_HZ
from groundlink.world.build import solids, world_hash

from .pace import AsFastAsOthers, Promises, RealTime
from .simulation import Simulation
from .truth import BodyTruth, Truth

HISTORY_TICKS = 1024
"""States kept for sensors that rejoin: more than a window and the longest revolution together."""

PATIENCE_SECONDS = 5.0
"""After this long without a step the processes that hold it up are named."""

VITALS_TICKS = TICK_RATE_HZ // VITALS_HZ

NAME = "physics"


class Physics:
    """The run's authority: simulation, pace and the bus, one tick at a time.

    Parameters
    ----------
    others
        processes beside the sensors without which a run does not begin, such as a recorder.
    """

    def __init__(
        self, scenario: Scenario, run: str, bus: Bus, *, others: Sequence[str] = ()
    ) -> None:
        self._run = run
        self._awaited = frozenset(others)
        self._follows_wall = scenario.time.epoch == "wall"
        self._world_hash = world_hash(scenario)
        static = solids(scenario)
        self._simulation = Simulation(scenario, static)
        self._clock = Schedule.at(scenario.time.clock_rate_hz)
        self._next_clock = 0
        self._history: deque[bytes] = deque(maxlen=HISTORY_TICKS)
        self._acks: dict[str, Ack] = {}
        self._publish_state = bus.publisher(STATE.key_in(run), STATE.delivery)
        self._publish_clock = bus.publisher(CLOCK.key_in(run), CLOCK.delivery)
        self._truths = [Truth(vehicle) for vehicle in scenario.vehicles]
        self._bodies = BodyTruth(scenario, static)
        self._publish_bodies = bus.publisher(BODIES.key_in(run), BODIES.delivery)
        self._publish_truth, self._publish_wheels, self._publish_vitals = (
            {
                v.name: bus.publisher(row.key_in(run, vehicle=v.name), row.delivery)
                for v in scenario.vehicles
            }
            for row in (GROUND_TRUTH, TRUE_WHEELS, VITALS)
        )
        self._promises = Promises({driver_name(v): v.name for v in scenario.vehicles})
        self._commands: Inbox[Command] = Inbox(depth=1024)
        self._arrived_acks: Inbox[Ack] = Inbox(depth=1024)
        self._command_keys = {
            COMMAND.key_in(run, vehicle=v.name): v.name for v in scenario.vehicles
        }
        for key in self._command_keys:
            bus.subscribe(key, Command, self._commands)
        bus.subscribe(ACK.key_in(run), Ack, self._arrived_acks)
        # Building the world and joining the bus take a while; sim time zero is when all is ready.
        self.epoch_nanos = time.time_ns() if self._follows_wall else 0
        self.pace = (
            RealTime(scenario.time.factor)
            if scenario.time.mode == "realtime"
            else AsFastAsOthers(
                dict.fromkeys((*scenario.sensor_names(), *others), scenario.time.window_ticks)
                | dict.fromkeys(driver_names(scenario), DRIVER_WINDOW_TICKS),
                scenario.time.window_ticks,
                self.epoch_nanos,
            )
        )
        self._ack_prefix = ACK.key_in(run, process="")
        self._health_prefix = HEALTH.key_in(run, process="")
        # Who is there already is told of at once, on another thread: what it needs stands above.
        bus.watch(HEALTH.key_in(run), self._on_liveliness)
        bus.serve(history_key(run), self._missed_by)
        bus.serve(scenario_key(run), lambda _: [msgspec.msgpack.encode(scenario)])

    @property
    def tick(self) -> int:
        """The last tick that was stepped to."""
        return self._simulation.tick

    def counters(self) -> dict[str, int]:
        """Return what a person who looks after the run wants to see."""
        return {
            "commands_dropped": self._commands.dropped,
            "refused": self._commands.refused + self._arrived_acks.refused,
        }

    def hear(self) -> None:
        """Take in what other processes have said."""
        while len(self._arrived_acks) and (arrived := self._arrived_acks.get(seconds=0)):
            name = arrived[0].removeprefix(self._ack_prefix)
            self._acks[name] = arrived[1]
            self._promises.given(name, arrived[1])
        while len(self._commands) and (command := self._commands.get(seconds=0)):
            key, asked = command
            since_start = replace(asked, stamp_nanos=asked.stamp_nanos - self.epoch_nanos)
            vehicle = self._command_keys[key]
            self._promises.commanded(vehicle, since_start.stamp_nanos // TICK_NANOS)
            try:
                self._simulation.command(vehicle, since_start)
            except ValueError:
                self._commands.refused += 1
        for name, ack in self._promises.kept():
            self.pace.acknowledged(name, ack)

    def missing(self) -> list[str]:
        """Return who is waited for: to be there once, and in a fast run to keep up."""
        return sorted({*self.pace.missing(), *self._awaited})

    def begin(self) -> None:
        """Publish the first state; where nobody has been told the epoch yet, it is now."""
        if self._follows_wall and isinstance(self.pace, RealTime):
            self.epoch_nanos = time.time_ns()
        # Tick 0 is now: whatever comes before the first step must not make all stamps older.
        self.pace.wait_seconds(0, time.monotonic())
        self.publish()

    def step(self) -> None:
        """Step one tick and publish what has become of the world."""
        self._simulation.step()
        self.publish()

    def publish(self) -> None:
        """Publish the state of this tick, and the clock and the ground truth when they are due."""
        simulation = self._simulation
        state = State(
            self._run,
            self.epoch_nanos,
            simulation.tick,
            simulation.tick * TICK_NANOS,
            self._world_hash,
            simulation.vehicle_states(),
        )
        self._history.append(self._publish_state(state))
        if self._clock.tick(self._next_clock) <= simulation.tick:
            self._next_clock += 1
            self._publish_clock(Clock(state.stamp_nanos, self.epoch_nanos, simulation.tick))
        for truth in self._truths:
            if (stamp := truth.due(state)) is not None:
                torques = simulation.motor_torques(truth.vehicle)
                self._publish_truth[truth.vehicle](truth.odometry(state, stamp))
                self._publish_wheels[truth.vehicle](truth.wheels(state, torques, stamp))
        if bodies := self._bodies.poses(state):
            self._publish_bodies(bodies)
        if simulation.tick % VITALS_TICKS == 0:
            for vitals in simulation.vitals(state.stamp_nanos):
                self._publish_vitals[vitals.vehicle](vitals)

    def close(self) -> None:
        """End the simulation."""
        self._simulation.close()

    def _missed_by(self, name: str) -> list[bytes]:
        """Answer a sensor that joins: where it resumes, and the states since then.

        In real time nobody is waited for and what was missed is gone: the answer is empty.
        """
        if isinstance(self.pace, RealTime):
            return []
        resume = self._acks.get(name, Ack(self.epoch_nanos, -1, -1))
        return [encode(resume), *self._history.copy()]

    def _on_liveliness(self, key: str, there: bool) -> None:
        name = key.removeprefix(self._health_prefix)
        if there:
            self._awaited = self._awaited - {name}
        else:
            self.pace.left(name)


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Run physics until `stop` is set."""
    parser = process.parser(NAME, "Simulate a scenario's world and vehicles.")
    parser.add_argument("scenario", help="scenario file (YAML)")
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help=f"be the router that others connect to (default {DEFAULT_ENDPOINT} without --connect)",
    )
    parser.add_argument(
        "--wait-for",
        metavar="PROCESS",
        action="append",
        default=[],
        help="a process without which the run does not begin, such as recorder; repeatable",
    )
    parser.add_argument("--mode", choices=("realtime", "fast"), help="instead of the scenario's")
    parser.add_argument(
        "--only", metavar="VEHICLE/SENSOR", help="leave out all other sensors of the scenario"
    )
    options = parser.parse_args(arguments)
    scenario = load(options.scenario)
    if options.only:
        if scenario.sensor(options.only) is None:
            hint = nearest(options.only, scenario.sensor_names())
            raise UserError(f"scenario `{scenario.name}` has no sensor `{options.only}`; {hint}")
        scenario = scenario.with_only(options.only)
    if options.mode:
        scenario = replace(scenario, time=replace(scenario.time, mode=options.mode))
    run = options.run or scenario.name
    listen = options.listen or (None if options.connect else DEFAULT_ENDPOINT)
    with Bus(connect=options.connect, listen=listen) as bus:
        if bus.present(HEALTH.key_in(run, process=NAME), seconds=1.0):
            raise UserError(f"run `{run}` is on the bus already; end it or give --run another name")
        physics = Physics(scenario, run, bus, others=options.wait_for)
        try:
            _keep_stepping(physics, process.Heartbeat(bus, run, NAME), stop.is_set)
        finally:
            physics.close()


def _keep_stepping(
    physics: Physics, heartbeat: process.Heartbeat, stopped: Callable[[], bool]
) -> None:
    """Step whenever the pace allows it, from a first state that all hear who are waited for."""
    last_step = time.monotonic()
    complained = has_begun = False
    while not stopped():
        now = time.monotonic()
        if heartbeat.due():
            heartbeat.beat(physics.tick, physics.counters())
        physics.hear()
        if not has_begun and not physics.missing():
            physics.begin()
            has_begun = True
        wait = physics.pace.wait_seconds(physics.tick + 1, now) if has_begun else 0.001
        if wait == 0.0:
            physics.step()
            last_step, complained = now, False
            continue
        if physics.missing() and now - last_step > PATIENCE_SECONDS and not complained:
            names = ", ".join(physics.missing())
            print(f"{NAME}: tick {physics.tick} waits for {names}", file=sys.stderr, flush=True)
            complained = True
        time.sleep(min(wait, 0.05))


if __name__ == "__main__":
    process.run(NAME, main)
