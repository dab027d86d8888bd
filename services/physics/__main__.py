# SPDX-License-Identifier: Apache-2.0
"""The physics process: steps the world, tells everybody its state, serves what replicas need.

Rule: the only process that reads the scenario's files and the only one that says what tick it is.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Sequence

import msgspec
from msgspec.structs import replace

from groundlink import asset_exchange, assets, process
from groundlink.bus import DEFAULT_ENDPOINT, Bus
from groundlink.clock import TICK_SECONDS
from groundlink.control import Remove, Spawn
from groundlink.errors import UserError
from groundlink.inbox import Inbox
from groundlink.messages import Ack, Command, WheelCommand
from groundlink.questions import control_key, history_key, scenario_key
from groundlink.scenario import Scenario, load
from groundlink.scenario.change import with_more, without
from groundlink.scenario.explain import nearest
from groundlink.topics import ACK, COMMAND, HEALTH, WHEEL_COMMAND

from .control import Control
from .life import Life, outlets

PATIENCE_SECONDS = 5.0
"""After this long without a step the processes that hold it up are named."""

PAUSED_SECONDS = 0.01
"""How often a run that is paused looks whether it shall go on."""

NAME = "physics"


class Physics:
    """The run's authority: its lives, the bus, and who is waited for.

    Parameters
    ----------
    others
        processes beside the sensors without which a run does not begin, such as a recorder.
    """

    def __init__(
        self, scenario: Scenario, run: str, bus: Bus, *, others: Sequence[str] = ()
    ) -> None:
        self._scenario, self._run, self._others = scenario, run, others
        self._awaited = frozenset(others)
        self._commands: Inbox[Command | WheelCommand] = Inbox(depth=1024)
        self._arrived_acks: Inbox[Ack] = Inbox(depth=1024)
        self._bus = bus
        self._command_keys: dict[str, str] = {}
        self._obey(scenario)
        bus.subscribe(ACK.key_in(run), Ack, self._arrived_acks)
        self._outlets = outlets(bus, run, scenario)
        self._changes = 0
        self.life = self._new_life()
        self._worlds = {self.life.world_hash: scenario}
        self.control = Control(self.reset, self.change)
        self._has_begun = False
        self._ack_prefix = ACK.key_in(run, process="")
        self._health_prefix = HEALTH.key_in(run, process="")
        # Who is there already is told of at once, on another thread: what it needs stands above.
        bus.watch(HEALTH.key_in(run), self._on_liveliness)
        bus.serve(history_key(run), lambda name: self.life.missed_by(name))
        bus.serve(control_key(run), self.control.answer)
        asset_exchange.serve(bus, run, lambda: self._scenario)
        bus.serve(scenario_key(run), self._scenario_of)

    def _obey(self, scenario: Scenario) -> None:
        """Take commands for a scenario's vehicles, where they are not taken yet."""
        for vehicle in scenario.vehicles:
            for row, message in ((COMMAND, Command), (WHEEL_COMMAND, WheelCommand)):
                key = row.key_in(self._run, vehicle=vehicle.name)
                if key not in self._command_keys:
                    self._command_keys[key] = vehicle.name
                    self._bus.subscribe(key, message, self._commands)

    def _scenario_of(self, world: str) -> list[bytes]:
        """Return the scenario of the world with this hash; of no hash, as it is now."""
        found = self._worlds.get(world) if world else self._scenario
        return [] if found is None else [msgspec.msgpack.encode(found)]

    def counters(self) -> dict[str, int]:
        """Return what a person who looks after the run wants to see."""
        return {
            "commands_dropped": self._commands.dropped,
            "refused": self._commands.refused + self._arrived_acks.refused,
            "worlds": self._changes,
        }

    def hear(self) -> None:
        """Take in what other processes and people have said."""
        while len(self._arrived_acks) and (arrived := self._arrived_acks.get(seconds=0)):
            self.life.acknowledged(arrived[0].removeprefix(self._ack_prefix), arrived[1])
        while len(self._commands) and (command := self._commands.get(seconds=0)):
            try:
                self.life.command(self._command_keys[command[0]], command[1])
            except (ValueError, KeyError):  # such as for a vehicle that was taken away
                self._commands.refused += 1
        self.life.settle()
        self.control.fulfil()

    def missing(self) -> list[str]:
        """Return who is waited for: to be there once, and in a fast run to keep up."""
        return sorted({*self.life.pace.missing(), *self._awaited})

    def wait_seconds(self, now_seconds: float) -> float:
        """Return how long to wait before the next step; 0 for not at all.

        The first state is published as soon as all hear it who are waited for.
        """
        if not self._has_begun and not self.missing():
            self._begin()
        if not self._has_begun:
            return 0.001
        if self.control.paused:
            self.life.pace.hold()
            return PAUSED_SECONDS
        return self.life.pace.wait_seconds(self.life.tick + 1, now_seconds)

    def step(self) -> None:
        """Step one tick and publish what has become of the world."""
        self.life.step()
        self.control.stepped(self.life.tick)

    def reset(self) -> None:
        """Begin another life with everything at its start."""
        self.life.end()
        self.life = self._new_life()
        self.control.stepped(0)
        if self._has_begun:
            # Others are there; a fast run waits for their words on its first state.
            self._begin()

    def change(self, wish: Spawn | Remove) -> None:
        """Put something into the world or take it out.

        Raises
        ------
        UserError
            when that cannot be.
        """
        before, now = self._scenario, self.life
        match wish:
            case Spawn(more=more):
                seconds = now.tick * TICK_SECONDS
                if lacking := assets.missing(asset_exchange.needed(more)):
                    raise UserError(
                        f"this machine lacks the data {lacking[0][:12]}; spawn meshes from the "
                        "machine where physics runs"
                    )
                scenario = with_more(before, more, now.moving(), seconds=seconds)
            case Remove(name=name):
                scenario = without(before, name)
        self._obey(scenario)
        self._outlets = outlets(self._bus, self._run, scenario, self._outlets)
        self._scenario = scenario
        self._changes += 1
        now.become(scenario, self._outlets)
        # Before the first state that has this hash, which comes with the next step.
        self._worlds[now.world_hash] = scenario

    def _begin(self) -> None:
        self.life.begin(time.time_ns(), time.monotonic())
        self._has_begun = True

    def _new_life(self) -> Life:
        return Life(
            *(self._scenario, self._run, self._outlets),
            others=self._others,
            wall_nanos=time.time_ns(),
        )

    def close(self) -> None:
        """End the simulation."""
        self.life.end()

    def _on_liveliness(self, key: str, there: bool) -> None:
        name = key.removeprefix(self._health_prefix)
        if there:
            self._awaited = self._awaited - {name}
        else:
            self.life.pace.left(name)


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
    router = process.router_of(options)
    listen = options.listen or (None if router else DEFAULT_ENDPOINT)
    with Bus(connect=router, listen=listen, name=NAME) as bus:
        process.alone(bus, run, NAME)
        physics = Physics(scenario, run, bus, others=options.wait_for)
        try:
            _keep_stepping(physics, process.Heartbeat(bus, run, NAME), stop.is_set)
        finally:
            physics.close()


def _keep_stepping(
    physics: Physics, heartbeat: process.Heartbeat, stopped: Callable[[], bool]
) -> None:
    """Step whenever the pace and people allow it."""
    last_step = time.monotonic()
    complained = False
    while not stopped():
        now = time.monotonic()
        if heartbeat.due():
            heartbeat.beat(physics.life.tick, physics.counters())
        physics.hear()
        wait = physics.wait_seconds(now)
        if wait == 0.0:
            physics.step()
        if wait == 0.0 or physics.control.paused:
            last_step, complained = now, False
        elif physics.missing() and now - last_step > PATIENCE_SECONDS and not complained:
            names = ", ".join(physics.missing())
            print(
                f"{NAME}: tick {physics.life.tick} waits for {names}", file=sys.stderr, flush=True
            )
            complained = True
        if wait:
            time.sleep(min(wait, 0.05))


if __name__ == "__main__":
    process.run(NAME, main)
