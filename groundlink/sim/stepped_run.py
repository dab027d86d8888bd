# SPDX-License-Identifier: Apache-2.0
"""A run that a program steps: `groundlink.run("indoor_lab")`.

The program takes the place of the gateway in lockstep with ROS: physics stops at each clock message
until the program acknowledges it, so a command acts in the next tick, on every machine.
"""

import os
import time
from collections import deque
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Literal

from msgspec.structs import replace

from groundlink.bus.control_client import fetch_journal, send_command
from groundlink.bus.core_topics import ACK, CLOCK, COMMAND, GATEWAY, HEALTH, PHYSICS, ROOT
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import GROUND_TRUTH, sensor_outputs
from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS
from groundlink.core.errors import RunFailed, UserError
from groundlink.episode import journal
from groundlink.episode.control import Remove, Reset
from groundlink.loader import load
from groundlink.messages.base import Ack, BusMessage, Clock, Command
from groundlink.monitor.process_commands import commands, free_endpoint
from groundlink.monitor.supervisor import Supervisor
from groundlink.scenario import Scenario

START_SECONDS = 60.0
"""Timeout for the start of all processes: cameras compile shaders."""

STEP_SECONDS = 60.0
"""Timeout for one period of the clock."""

LINES_KEPT = 20
INBOX_DEPTH = 1 << 16

Mode = Literal["fast", "lockstep"]


class SteppedRun:
    """A run whose sim time advances in `step` only. Use it as a context manager.

    The processes are those of `groundlink up`, without gateway and ROS. Commands such as
    `groundlink fault` or `groundlink view` join it by `name` and `endpoint`. Two runs of the same
    scenario with the same commands give the same readings, to the last bit.

    Parameters
    ----------
    scenario
        scenario file, or name of a shipped scenario.
    mode
        `fast`: as fast as possible. `lockstep`: no faster than the scenario's `time.factor`.
    sensors_together
        run all sensors in one process: less overhead, but they wait for each other.

    Raises
    ------
    UserError
        when the scenario is wrong or a process cannot run here.
    """

    def __init__(
        self, scenario: str | Path, *, mode: Mode = "fast", sensors_together: bool = False
    ) -> None:
        given = load(scenario)
        self.scenario: Scenario = replace(
            given, time=replace(given.time, mode=mode, lockstep="ros")
        )
        self.name = f"{given.name}_{os.getpid()}"
        """Name of the run, for other commands: `--run`."""

        self.endpoint = free_endpoint()
        """Endpoint of its router: `--connect`."""

        self._episode, self._tick, self._epoch_nanos = -1, -1, 0
        self._latest: dict[str, BusMessage] = {}
        self._acknowledged: dict[str, tuple[int, int]] = {}
        self._commanded: dict[str, int] = {}
        self._sensors = self.scenario.sensor_names()
        self._types: dict[str, type[BusMessage]] = dict(self._rows())
        prefix = f"{ROOT}/{self.name}/"
        self.streams: Mapping[str, type[BusMessage]] = {
            key.removeprefix(prefix): message
            for key, message in self._types.items()
            if message not in (Ack, Clock)
        }
        """Type of the messages of each stream that `latest` knows."""

        self._inbox: BusInbox[BusMessage] = BusInbox(depth=INBOX_DEPTH)
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)
        processes = commands(
            self.scenario,
            str(scenario),
            self.name,
            self.endpoint,
            sensors_together=sensors_together,
        )
        del processes[GATEWAY]
        processes[PHYSICS] += ["--mode", mode, "--lockstep", "ros"]
        self._supervisor = Supervisor(processes, self._log)
        with ExitStack() as opened:
            self._bus = opened.enter_context(Bus(listen=self.endpoint))
            self._bus.subscribe_in_order(f"{ROOT}/{self.name}/**", self._type_of, self._inbox)
            self._bus.announce(HEALTH.key_in(self.name, process=GATEWAY))
            acknowledge = ACK.key_in(self.name, process=GATEWAY)
            self._acknowledge = self._bus.publisher(acknowledge, ACK.delivery)
            self._publishers = {
                vehicle.name: self._bus.publisher(
                    COMMAND.key_in(self.name, vehicle=vehicle.name), COMMAND.delivery
                )
                for vehicle in self.scenario.vehicles
            }
            opened.callback(self._supervisor.stop)
            self._supervisor.start()
            self._wait(0, START_SECONDS)
            self._opened = opened.pop_all()

    def __enter__(self) -> "SteppedRun":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End all processes of the run."""
        self._opened.close()

    @property
    def processes(self) -> Mapping[str, int]:
        """Process ids of the run's processes that are running, by name."""
        children = self._supervisor.children.values()
        return {child.name: child.pid for child in children if child.pid is not None}

    @property
    def time_s(self) -> float:
        """Sim time in seconds."""
        return self._tick * TICK_SECONDS

    @property
    def step_s(self) -> float:
        """Shortest step in seconds: the period of the scenario's clock."""
        return self.scenario.time.ack_ticks * TICK_SECONDS

    def step(self, seconds: float | None = None) -> None:
        """Advance sim time; when it returns, all readings up to the new time are in `latest`.

        Parameters
        ----------
        seconds
            multiple of `step_s`; one `step_s` if None.

        Raises
        ------
        UserError
            when `seconds` is no multiple, or a process of the run ended.
        """
        period = self.scenario.time.ack_ticks
        ticks = period if seconds is None else seconds * TICK_RATE_HZ
        if ticks < period or abs(ticks / period - round(ticks / period)) > 1e-6:
            raise UserError(
                f"step: {seconds:g} s is no multiple of {self.step_s:g} s. Fix: choose one, or set "
                "`time.clock_rate_hz` of the scenario"
            )
        end = self._tick + round(ticks)
        while self._tick < end:
            self._acknowledge(
                Ack(self._episode, self._tick, self._tick, commanded=dict(self._commanded))
            )
            self._wait(self._tick + period, STEP_SECONDS)

    def command(self, vehicle: str, linear_mps: float, angular_radps: float) -> None:
        """Command the velocity of a vehicle: forward and about z. It acts in the next tick.

        Raises
        ------
        UserError
            when there is no such vehicle.
        """
        if vehicle not in self._publishers:
            raise UserError(
                f"no vehicle `{vehicle}`; expected one of {', '.join(self._publishers)}"
            )
        stamp_nanos = self._epoch_nanos + self._tick * TICK_NANOS
        velocity = Command(stamp_nanos, (linear_mps, 0.0, 0.0), (0.0, 0.0, angular_radps))
        self._publishers[vehicle](velocity)
        self._commanded[vehicle] = self._tick

    def latest(self, stream: str) -> Any:
        """Return the newest message of a stream, or None before the first.

        Parameters
        ----------
        stream
            such as `rover/lidar`, `rover/lidar/truth` or `rover/ground_truth`; see `streams`.

        Raises
        ------
        UserError
            when there is no such stream.
        """
        if stream not in self.streams:
            raise UserError(f"no stream `{stream}`; expected one of {', '.join(self.streams)}")
        return self._latest.get(stream)

    def reset(self) -> None:
        """Start again from the initial state, at sim time zero."""
        before = self._episode
        send_command(self._bus, self.name, Reset())
        self._wait(0, START_SECONDS, after_episode=before)

    def remove(self, name: str) -> None:
        """Remove a vehicle, an actor or a solid."""
        send_command(self._bus, self.name, Remove(name))

    def save(self, file: str | Path) -> None:
        """Write the state of the run to a file that `groundlink up` continues."""
        content = fetch_journal(self._bus, self.name)
        journal.loaded(content, f"run `{self.name}`")
        journal.write(Path(file), content)

    def _rows(self) -> Any:
        """Yield key and type of each message that the program takes."""
        yield CLOCK.key_in(self.name), CLOCK.message
        for name in self._sensors:
            yield ACK.key_in(self.name, process=name), ACK.message
        for vehicle in self.scenario.vehicles:
            yield GROUND_TRUTH.key_in(self.name, vehicle=vehicle.name), GROUND_TRUTH.message
            for sensor in vehicle.sensors:
                for output in sensor_outputs(sensor):
                    key = output.row.key_in(self.name, vehicle=vehicle.name, sensor=sensor.name)
                    yield key, output.row.message

    def _type_of(self, key: str) -> type[BusMessage] | None:
        return self._types.get(key)

    def _log(self, process: str, line: str) -> None:
        self._lines.append(line if line.startswith(f"{process}: ") else f"{process}: {line}")

    def _wait(self, tick: int, seconds: float, *, after_episode: int = -1) -> None:
        """Take messages until physics and all sensors have reached a tick.

        Raises
        ------
        UserError
            when a process ended, or after `seconds`.
        """
        prefix = f"{ROOT}/{self.name}/"
        deadline = time.monotonic() + seconds
        while not self._has_reached(tick, after_episode):
            arrived = self._inbox.get(seconds=0.05)
            if arrived is not None:
                self._take(arrived[0].removeprefix(prefix), arrived[1])
                continue
            if failed := self._supervisor.poll():
                raise RunFailed(f"{failed} ended the run: {' | '.join(self._lines)}")
            if time.monotonic() > deadline:
                behind = ", ".join(self._behind(tick)) or PHYSICS
                raise RunFailed(
                    f"{behind}: not at tick {tick} within {seconds:g} s: {' | '.join(self._lines)}"
                )

    def _has_reached(self, tick: int, after_episode: int) -> bool:
        return self._episode > after_episode and self._tick >= tick and not self._behind(tick)

    def _behind(self, tick: int) -> list[str]:
        """Return the sensors that have not acknowledged a tick of this episode."""
        reached = self._acknowledged
        wanted = self._episode, tick
        return [n for n in self._sensors if reached.get(n, (-1, -1)) < wanted]

    def _take(self, key: str, message: BusMessage) -> None:
        if isinstance(message, Clock):
            if message.episode != self._episode:
                self._latest.clear()
                self._commanded.clear()
            self._episode, self._tick = message.episode, message.tick
            self._epoch_nanos = message.epoch_nanos
        elif isinstance(message, Ack):
            self._acknowledged[key.removeprefix("ack/")] = message.episode, message.tick
        else:
            self._latest[key] = message
