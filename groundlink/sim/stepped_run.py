# SPDX-License-Identifier: Apache-2.0
"""A run that a program steps: `groundlink.run("indoor_lab")`.

The program takes the place of the gateway in lockstep with ROS: physics stops at each clock message
until the program acknowledges it, so a command acts in the next tick, on every machine.
"""

import os
import threading
import time
import warnings
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec

from groundlink.bus.control_client import (
    ask_world,
    fetch_journal,
    restoring,
    run_status,
    send_command,
)
from groundlink.bus.core_topics import ACK, CLOCK, COMMAND, GATEWAY, HEALTH, PHYSICS, RECORDER, ROOT
from groundlink.bus.fault_client import send_fault
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import vehicle_streams
from groundlink.core.clock import TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS
from groundlink.core.errors import RunFailed, UserError
from groundlink.episode import journal
from groundlink.episode.control import Remove, Reset, Spawn
from groundlink.episode.world_queries import (
    AnyWorldQuery,
    LoadWorldQuery,
    RemoveQuery,
    ResetQuery,
    SpawnQuery,
    UnloadWorldQuery,
)
from groundlink.loader import load
from groundlink.loader.additions import SpawnPlace, addition_to
from groundlink.messages.base import Ack, BusMessage, Clock, Command
from groundlink.monitor import process_commands
from groundlink.monitor.supervisor import Supervisor
from groundlink.process.joining import join
from groundlink.scenario import Scenario
from groundlink.scenario.faults import Fault

from .sim_time import Mode, as_stepped, check_step

START_SECONDS = 60.0
"""Timeout for the start of all processes: cameras compile shaders."""

STEP_SECONDS = 60.0
"""Timeout for one period of the clock."""

RESTORED_SECONDS = 5.0
"""Sim time that a start from a saved run restores in a second at least."""

RECORDER_SECONDS = 60.0
"""Timeout for the recorder to take all messages up to the last step, and to complete its file."""

LINES_KEPT = 20
INBOX_DEPTH = 1 << 16


class SteppedRun:
    """A run whose sim time advances in `step` only. Use it as a context manager.

    The processes are those of `groundlink up`, without gateway and ROS. Commands such as
    `groundlink fault` or `groundlink view` join it by `name` and `endpoint`. Two runs of the same
    scenario with the same commands give the same readings, to the last bit.

    Parameters
    ----------
    scenario
        scenario file, name of a shipped scenario, or a saved run to continue.
    mode
        `fast`: as fast as possible. `lockstep`: no faster than the scenario's `time.factor`.
    sensors_together
        run all sensors in one process: less overhead, but they wait for each other.
    record
        also record the run to this MCAP file, which `close` completes. After a reset or a restore
        another file follows, such as `run_2.mcap`.
    name
        name of the run, also in a recording; by default, the scenario's with the process id.

    Raises
    ------
    UserError
        when the scenario is wrong or a process cannot run here.
    """

    def __init__(
        self,
        scenario: str | Path,
        *,
        mode: Mode = "fast",
        sensors_together: bool = False,
        record: str | Path | None = None,
        name: str | None = None,
    ) -> None:
        saved = None
        if journal.is_saved_run(Path(scenario)):
            saved = journal.loaded(journal.read(Path(scenario)), str(scenario))
        given = load(scenario) if saved is None else saved.remaining_scenario()
        self.scenario = as_stepped(given, mode)
        """The scenario at present, with what was spawned and without what was removed."""

        self.name = name or f"{given.name}_{os.getpid()}"
        """Name of the run, for other commands: `--run`."""

        self.endpoint = process_commands.free_endpoint()
        """Endpoint of its router: `--connect`."""

        self._episode, self._tick, self._epoch_nanos = -1, -1, 0
        self._latest: dict[str, BusMessage] = {}
        self._acks: defaultdict[str, Ack] = defaultdict(lambda: Ack(-1, -1, -1))
        self._commanded: dict[str, tuple[int, int]] = {}  # newest tick, and number at that tick
        self._publishers: dict[str, Callable[[BusMessage], bytes]] = {}
        self._inbox: BusInbox[BusMessage] = BusInbox(depth=INBOX_DEPTH)
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)
        processes = process_commands.stepped(
            *(self.scenario, str(scenario), self.name, self.endpoint),
            mode=mode,
            sensors_together=sensors_together,
            record=None if record is None else Path(record),
        )
        self._supervisor = Supervisor(processes, self._log)
        with ExitStack() as opened:
            self._bus = opened.enter_context(Bus(listen=self.endpoint))
            self._adopt(self.scenario)
            self._bus.subscribe_in_order(f"{ROOT}/{self.name}/**", self._type_of, self._inbox)
            self._bus.announce(HEALTH.key_in(self.name, process=GATEWAY))
            acknowledge = ACK.key_in(self.name, process=GATEWAY)
            self._acknowledge = self._bus.publisher(acknowledge, ACK.delivery)
            opened.callback(self._supervisor.stop)
            self._supervisor.start()
            if saved is None:
                self._wait(0, START_SECONDS)
            else:
                restoring_s = saved.tick * TICK_SECONDS / RESTORED_SECONDS
                self._wait_restored(saved, START_SECONDS + restoring_s)
            if record is not None:
                opened.callback(self._end_recording)
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
        return self._tick / TICK_RATE_HZ

    @property
    def step_s(self) -> float:
        """Shortest step in seconds: the period of the scenario's clock."""
        return self.scenario.time.ack_ticks * TICK_SECONDS

    def step(self, seconds: float | None = None) -> None:
        """Advance sim time; when it returns, all readings up to the new time are in `latest`.

        Parameters
        ----------
        seconds
            multiple of `step_s`; one `step_s` if None. Where a restored run is between two steps,
            the first one is shorter.

        Raises
        ------
        UserError
            when `seconds` is no multiple, or a process of the run ended.
        """
        period = self.scenario.time.ack_ticks
        ticks = period if seconds is None else check_step(self.scenario, seconds)
        end = self._last_barrier(self._tick) + ticks
        while self._tick < end:
            commanded = {name: tick for name, (tick, _) in self._commanded.items()}
            several = {name: count for name, (_, count) in self._commanded.items() if count > 1}
            ack = Ack(self._episode, self._tick, self._tick, commanded=commanded, commands=several)
            self._acknowledge(ack)
            self._wait(self._last_barrier(self._tick) + period, STEP_SECONDS)

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
        forward, turn = float(linear_mps), float(angular_radps)  # of NumPy's types, too
        velocity = Command(stamp_nanos, (forward, 0.0, 0.0), (0.0, 0.0, turn))
        self._publishers[vehicle](velocity)
        newest, count = self._commanded.get(vehicle, (-1, 0))
        self._commanded[vehicle] = self._tick, count + 1 if newest == self._tick else 1

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
        self._wait_recorded()
        send_command(self._bus, self.name, Reset())
        self._wait(0, START_SECONDS, after_episode=before)

    def spawn(
        self,
        what: str | Path,
        *,
        x_m: float,
        y_m: float,
        z_m: float = 0.0,
        yaw_deg: float = 0.0,
        name: str | None = None,
    ) -> str:
        """Add a vehicle or an obstacle from the next tick on; return its name.

        A spawned vehicle takes commands and has a ground truth, but no sensors. A reset keeps it.

        Parameters
        ----------
        what
            file of a vehicle, file of a world with solids or actors, name of a shipped vehicle, or
            `box`, `barrel`, `person` or `crate`.
        x_m, y_m, z_m
            position of its origin in the world; z above the ground.
        yaw_deg
            heading, counterclockwise from x.
        name
            name in the run; derived from `what` if None.

        Raises
        ------
        UserError
            when there is no such thing, the name is taken, or the place is occupied.
        """
        place = SpawnPlace(x_m, y_m, z_m, yaw_deg)
        called, more = addition_to(self.scenario, str(what), at=place, name=name)
        send_command(self._bus, self.name, Spawn(more))
        self._adopt(self._present())
        return called

    def remove(self, name: str) -> None:
        """Remove a vehicle, an actor or a solid from the next tick on. A reset keeps it removed.

        Raises
        ------
        UserError
            when there is no such thing, or it is part of the world or the only vehicle.
        """
        send_command(self._bus, self.name, Remove(name))
        self._adopt(self._present())

    def ask(self, query: AnyWorldQuery) -> dict[str, Any]:
        """Return the answer to a world query; what it changes is so from the next tick on.

        Parameters
        ----------
        query
            an object of `groundlink.episode.world_queries`, but for those that may begin another
            episode: resets, for which there is `reset`, and loading and unloading a world.

        Raises
        ------
        UserError
            when it cannot be answered; nothing is changed then.
        """
        if isinstance(query, ResetQuery | LoadWorldQuery | UnloadWorldQuery):
            raise UserError(
                f"ask: a stepped run takes no {type(query).__name__}. Fix: call `reset()`, or "
                "start another run for another world"
            )
        answer: dict[str, Any] = msgspec.json.decode(
            ask_world(self._bus, self.name, msgspec.json.encode(query))
        )
        if problem := answer.get("error"):
            raise UserError(problem)
        if isinstance(query, SpawnQuery | RemoveQuery):
            self._adopt(self._present())
        return answer

    def fault(self, sensor: str, fault: Fault) -> tuple[Fault, ...]:
        """Inject a fault into a sensor from the next tick on; return all its active faults.

        Parameters
        ----------
        sensor
            such as `rover/imu`.
        fault
            an object of `groundlink.scenario.faults`, such as `Stuck(for_s=2.0)`. Its `at_s` is
            ignored.

        Raises
        ------
        UserError
            when there is no such sensor, or it cannot have the fault.
        """
        return send_fault(self._bus, self.name, self.scenario, sensor, fault).active

    def clear_faults(self, sensor: str) -> None:
        """End all faults of a sensor from the next tick on.

        Raises
        ------
        UserError
            when there is no such sensor.
        """
        send_fault(self._bus, self.name, self.scenario, sensor, None)

    def save(self, file: str | Path) -> None:
        """Write the state of the run to a file, for `restore`, `run` or `groundlink up`.

        Raises
        ------
        UserError
            when the file cannot be written.
        """
        content = fetch_journal(self._bus, self.name)
        journal.loaded(content, f"run `{self.name}`")
        journal.write(Path(file), content)

    def restore(self, file: str | Path) -> None:
        """Continue from a saved state of this run, or of one with the same sensors and seed.

        Readings from before the saved state are not in `latest`.

        Raises
        ------
        UserError
            when the file is no saved run, or does not fit this run, which is then unchanged.
        """
        content = journal.read(Path(file))
        saved = journal.loaded(content, str(file))
        before = self._episode
        self._wait_recorded()
        for _ in restoring(self._bus, self.name, content):
            pass
        self._wait_restored(saved, START_SECONDS, after_episode=before)

    def _present(self) -> Scenario:
        """Return the scenario that physics simulates now."""
        return join(self._bus, self.name, threading.Event())[1]

    def _adopt(self, scenario: Scenario) -> None:
        """Take the messages of a scenario's sensors and vehicles, and command those vehicles."""
        self.scenario = scenario
        self._sensors = scenario.sensor_names()
        of_vehicles = dict(vehicle_streams(scenario, self.name))
        acks = (ACK.key_in(self.name, process=name) for name in (*self._sensors, RECORDER))
        self._types: dict[str, type[BusMessage]] = {
            CLOCK.key_in(self.name): Clock,
            **dict.fromkeys(acks, Ack),
            **of_vehicles,
        }
        prefix = f"{ROOT}/{self.name}/"
        self.streams: Mapping[str, type[BusMessage]] = {
            key.removeprefix(prefix): message for key, message in of_vehicles.items()
        }
        """Type of the messages of each stream that `latest` knows."""

        self._publishers = {
            vehicle.name: self._publishers.get(vehicle.name) or self._publisher(vehicle.name)
            for vehicle in scenario.vehicles
        }

    def _publisher(self, vehicle: str) -> Callable[[BusMessage], bytes]:
        """Return the publisher of a vehicle's commands."""
        return self._bus.publisher(COMMAND.key_in(self.name, vehicle=vehicle), COMMAND.delivery)

    def _wait_restored(
        self, saved: journal.Journal, seconds: float, *, after_episode: int = -1
    ) -> None:
        """Wait until the run is at the tick of a saved one; adopt its scenario."""
        self._wait(self._last_barrier(saved.tick), seconds, after_episode=after_episode)
        self._adopt(self._present())
        if warning := run_status(self._bus, self.name).warning:
            warnings.warn(warning, stacklevel=3)

    def _last_barrier(self, tick: int) -> int:
        """Return the last tick up to this one at which physics waits for the program."""
        period = self.scenario.time.ack_ticks
        return tick // period * period

    def _end_recording(self) -> None:
        """Let the recorder take all messages and complete its file while physics is running."""
        self._wait_recorded()
        if self._supervisor.stop([RECORDER], seconds=RECORDER_SECONDS):
            warnings.warn("recording: incomplete; its file took too long to write", stacklevel=2)

    def _wait_recorded(self) -> None:
        """Wait until the recorder, if there is one, has all messages up to the last step."""
        if RECORDER not in self._supervisor.children:
            return
        # Says that all commands have been sent, and does not let physics step.
        barrier = self._last_barrier(self._tick)
        self._acknowledge(Ack(self._episode, barrier - 1, self._tick))
        deadline = time.monotonic() + RECORDER_SECONDS
        while (ack := self._acks[RECORDER]).settled_tick < barrier or ack.episode != self._episode:
            if arrived := self._inbox.get(seconds=0.05):
                self._take(*arrived)
                continue
            ended = ", ".join(self._supervisor.not_running())
            if ended or time.monotonic() > deadline:
                cause = f"{ended} ended" if ended else f"not taken within {RECORDER_SECONDS:g} s"
                warnings.warn(f"recording: last messages may be missing: {cause}", stacklevel=3)
                return

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
        deadline = time.monotonic() + seconds
        while not self._has_reached(tick, after_episode):
            arrived = self._inbox.get(seconds=0.05)
            if arrived is not None:
                self._take(*arrived)
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
        acks = ((name, self._acks[name]) for name in self._sensors)
        return [n for n, ack in acks if (ack.episode, ack.tick) < (self._episode, tick)]

    def _take(self, key: str, message: BusMessage) -> None:
        key = key.removeprefix(f"{ROOT}/{self.name}/")
        if isinstance(message, Clock):
            if message.episode != self._episode:
                self._latest.clear()
                self._commanded.clear()
            self._episode, self._tick = message.episode, message.tick
            self._epoch_nanos = message.epoch_nanos
        elif isinstance(message, Ack):
            self._acks[key.removeprefix("ack/")] = message
        else:
            self._latest[key] = message
