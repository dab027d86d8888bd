# SPDX-License-Identifier: Apache-2.0
"""Command lines of the processes of a run. Services are started as ``python -m`` only."""

import os
import socket
from collections import defaultdict
from collections.abc import Collection, Sequence
from pathlib import Path

from groundlink.bus.core_topics import GATEWAY, PHYSICS, RECORDER
from groundlink.bus.topics import driver_names, process_names
from groundlink.core.atomic_file import check_new_file
from groundlink.core.extras import check_installed
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.sensor_kinds import shares_process

SENSORS = "sensors"
"""Name of the shared process of all sensors."""

SHARED_MODULE = "services.sensors"
"""Module of several sensors in one process."""


def sensor_processes(
    scenario: Scenario, wanted: Collection[str], *, cores: int | None = None
) -> dict[str, list[str]]:
    """Return the command lines of the processes of sensors, without what joins them to a run.

    Light sensors of a vehicle share a process, each other one has its own. Of more vehicles than
    cores, several share a process of light sensors, and one of each other kind: every process gets
    the states of all vehicles. A process of several sensors has all their names, such as
    `rover/imu+encoders`. The sensor with the highest rate is the first that gets a state.

    Parameters
    ----------
    cores
        processors that the processes may use; None: those of this process.
    """
    cores = cores or len(os.sched_getaffinity(0))
    vehicles = scenario.vehicles
    groups: dict[tuple[int, str], dict[str, SensorSpec]] = defaultdict(dict)
    for index, vehicle in enumerate(vehicles):
        share = index * min(cores, len(vehicles)) // len(vehicles)
        for sensor in vehicle.sensors:
            name = f"{vehicle.name}/{sensor.name}"
            if name in wanted:
                is_own = len(vehicles) <= cores or sensor.process == "own"
                own = "" if shares_process(sensor) else name if is_own else sensor.kind
                groups[share, own][name] = sensor
    modules, found = process_names(scenario), {}
    for sensors in groups.values():
        names = sorted(sensors, key=lambda name: -sensors[name].message_rate_hz)
        module = modules[names[0]] if len(names) == 1 else SHARED_MODULE
        found[_joint_name(names)] = ["-m", module, *(w for n in names for w in ("--name", n))]
    return found


def _joint_name(names: Sequence[str]) -> str:
    """Return the name of a process of sensors: its vehicles, and its sensors once each."""
    pairs = [name.split("/") for name in names]
    vehicles, sensors = ([*dict.fromkeys(column)] for column in zip(*pairs, strict=True))
    first, last = vehicles[0], vehicles[-1]
    return f"{first if first == last else f'{first}..{last}'}/{'+'.join(sensors)}"


def commands(
    scenario: Scenario, file: str, run: str, endpoint: str, *, sensors_together: bool = False
) -> dict[str, list[str]]:
    """Return the command line of every process of a run; all sensors may share one process."""
    sensors = scenario.sensor_names()
    of_sensors = sensor_processes(scenario, sensors)
    if sensors_together and sensors:
        of_sensors = {SENSORS: ["-m", SHARED_MODULE]}
    modules = process_names(scenario)
    found = {PHYSICS: ["-m", modules[PHYSICS], file], **of_sensors}
    for name in driver_names(scenario):
        found[name] = ["-m", modules[name], "--name", name]
    found[GATEWAY] = ["-m", modules[GATEWAY]]
    return {name: [*command, *joining(run, endpoint)] for name, command in found.items()}


def stepped(
    scenario: Scenario,
    file: str,
    run: str,
    endpoint: str,
    *,
    mode: str,
    sensors_together: bool,
    record: Path | None,
) -> dict[str, list[str]]:
    """Return the command lines of a run that a program steps, which stands for its gateway.

    Parameters
    ----------
    mode
        time mode of physics.
    record
        new file to record to, if any.

    Raises
    ------
    UserError
        if the file exists.
    RequirementError
        as `recorder`.
    """
    found = commands(scenario, file, run, endpoint, sensors_together=sensors_together)
    del found[GATEWAY]
    found[PHYSICS] += ["--mode", mode, "--lockstep", "ros"]
    if record is not None:
        check_new_file("record", record)
        found[RECORDER] = [*recorder(str(record), run, endpoint), "--ordered"]
        found[PHYSICS] += ["--wait-for", RECORDER]
    return found


def following(
    scenario: Scenario,
    journal: Path,
    recorder: list[str],
    run: str,
    endpoint: str,
    *,
    sensors: Collection[str],
) -> dict[str, list[str]]:
    """Return the command lines of a run that repeats a journal with some of its sensors.

    Parameters
    ----------
    scenario
        scenario of the journal.
    recorder
        command line of the process that takes the place of the recorder, without what joins it.
    sensors
        names of the sensors that run; the recorder stands in for all others.
    """
    modules = process_names(scenario)
    joined = joining(run, endpoint)
    physics = ["-m", modules[PHYSICS], "--follow", str(journal), "--wait-for", RECORDER, *joined]
    found = {PHYSICS: physics, RECORDER: [*recorder, *joined]}
    of_sensors = sensor_processes(scenario, sensors)
    return found | {name: [*command, *joined] for name, command in of_sensors.items()}


def recorder(out: str, run: str, endpoint: str) -> list[str]:
    """Return the command line of a recorder.

    Raises
    ------
    RequirementError
        if the extra `record` is not installed; otherwise the run would wait for its recorder.
    """
    check_installed(("mcap", "rosbags", "zstandard"), "record")
    return ["-m", "services.recorder", "--out", out, *joining(run, endpoint)]


def free_endpoint() -> str:
    """Return a free endpoint of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def joining(run: str, endpoint: str) -> list[str]:
    """Return the arguments of a process that joins a run."""
    return ["--connect", endpoint, "--run", run]
