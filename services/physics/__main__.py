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
from groundlink.clock import TICK_NANOS, Schedule
from groundlink.errors import UserError
from groundlink.inbox import Inbox
from groundlink.messages import Ack, Clock, Command, State, encode
from groundlink.scenario import Scenario, load
from groundlink.topics import (
    ACK,
    CLOCK,
    COMMAND,
    GROUND_TRUTH,
    HEALTH,
    STATE,
    history_key,
    scenario_key,
)
from groundlink.world.build import solids, world_hash

from .pace import AsFastAsSensors, RealTime
from .simulation import Simulation
from .truth import Truth

HISTORY_TICKS = 1024
"""States kept for sensors that rejoin: more than a window and the longest revolution together."""

PATIENCE_SECONDS = 5.0
"""After this long without a step the processes that hold it up are named."""

NAME = "physics"


class Physics:
    """The run's authority: simulation, pace and the bus, one tick at a time."""

    def __init__(self, scenario: Scenario, run: str, bus: Bus) -> None:
        self._run = run
        self._world_hash = world_hash(scenario)
        self._simulation = Simulation(scenario, solids(scenario))
        self._clock = Schedule.at(scenario.time.clock_rate_hz)
        self._next_clock = 0
        self._history: deque[bytes] = deque(maxlen=HISTORY_TICKS)
        self._acks: dict[str, Ack] = {}
        self._publish_state = bus.publisher(STATE.key_in(run), STATE.delivery)
        self._publish_clock = bus.publisher(CLOCK.key_in(run), CLOCK.delivery)
        self._truths = [Truth(vehicle) for vehicle in scenario.vehicles]
        self._publish_truth = {
            v.name: bus.publisher(GROUND_TRUTH.key_in(run, vehicle=v.name), GROUND_TRUTH.delivery)
            for v in scenario.vehicles
        }
        self._commands: Inbox[Command] = Inbox(depth=64)
        self._arrived_acks: Inbox[Ack] = Inbox(depth=1024)
        self._command_keys = {
            COMMAND.key_in(run, vehicle=v.name): v.name for v in scenario.vehicles
        }
        for key in self._command_keys:
            bus.subscribe(key, Command, self._commands)
        bus.subscribe(ACK.key_in(run), Ack, self._arrived_acks)
        # Building the world and joining the bus take a while; sim time zero is when all is ready.
        self.epoch_nanos = time.time_ns() if scenario.time.epoch == "wall" else 0
        self.pace = (
            RealTime(scenario.time.factor)
            if scenario.time.mode == "realtime"
            else AsFastAsSensors(
                scenario.sensor_names(), scenario.time.window_ticks, self.epoch_nanos
            )
        )
        # Tick 0 is now: whatever comes before the first step must not make all stamps older.
        self.pace.wait_seconds(0, time.monotonic())
        bus.watch(HEALTH.key_in(run), self._on_liveliness)
        bus.serve(history_key(run), self._missed_by)
        bus.serve(scenario_key(run), lambda _: [msgspec.msgpack.encode(scenario)])
        self._ack_prefix = ACK.key_in(run, process="")
        self._health_prefix = HEALTH.key_in(run, process="")

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
            self.pace.acknowledged(name, arrived[1])
        while len(self._commands) and (command := self._commands.get(seconds=0)):
            key, asked = command
            since_start = replace(asked, stamp_nanos=asked.stamp_nanos - self.epoch_nanos)
            try:
                self._simulation.command(self._command_keys[key], since_start)
            except ValueError:
                self._commands.refused += 1

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
            if odometry := truth.odometry(state):
                self._publish_truth[truth.vehicle](odometry)

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
        if not there:
            self.pace.left(key.removeprefix(self._health_prefix))


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Run physics until `stop` is set."""
    parser = process.parser(NAME, "Simulate a scenario's world and vehicles.")
    parser.add_argument("scenario", help="scenario file (YAML)")
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        help=f"be the router that others connect to (default {DEFAULT_ENDPOINT} without --connect)",
    )
    options = parser.parse_args(arguments)
    scenario = load(options.scenario)
    run = options.run or scenario.name
    listen = options.listen or (None if options.connect else DEFAULT_ENDPOINT)
    with Bus(connect=options.connect, listen=listen) as bus:
        if bus.present(HEALTH.key_in(run, process=NAME), seconds=1.0):
            raise UserError(f"run `{run}` is on the bus already; end it or give --run another name")
        physics = Physics(scenario, run, bus)
        try:
            _keep_stepping(physics, process.Heartbeat(bus, run, NAME), stop.is_set)
        finally:
            physics.close()


def _keep_stepping(
    physics: Physics, heartbeat: process.Heartbeat, stopped: Callable[[], bool]
) -> None:
    """Step whenever the pace allows it."""
    physics.publish()
    last_step = time.monotonic()
    complained = False
    while not stopped():
        now = time.monotonic()
        if heartbeat.due():
            heartbeat.beat(physics.tick, physics.counters())
        physics.hear()
        wait = physics.pace.wait_seconds(physics.tick + 1, now)
        if wait == 0.0:
            physics.step()
            last_step, complained = now, False
            continue
        if physics.pace.missing() and now - last_step > PATIENCE_SECONDS and not complained:
            names = ", ".join(physics.pace.missing())
            print(f"{NAME}: tick {physics.tick} waits for {names}", file=sys.stderr, flush=True)
            complained = True
        time.sleep(min(wait, 0.05))


if __name__ == "__main__":
    process.run(NAME, main)
