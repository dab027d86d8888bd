# SPDX-License-Identifier: Apache-2.0
"""Command lines of the processes of a run. Services are started as ``python -m`` only."""

import socket
from collections import defaultdict
from collections.abc import Collection
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


def sensor_processes(scenario: Scenario, wanted: Collection[str]) -> dict[str, list[str]]:
    """Return the command lines of the processes of sensors, without what joins them to a run.

    A process of several sensors has all their names, such as `rover/imu+encoders`. The sensor with
    the highest rate is the first that gets a state.
    """
    groups: dict[tuple[str, str], list[SensorSpec]] = defaultdict(list)
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            if f"{vehicle.name}/{sensor.name}" in wanted:
                own = "" if shares_process(sensor) else sensor.name
                groups[vehicle.name, own].append(sensor)
    modules, found = process_names(scenario), {}
    for (vehicle_name, _), sensors in groups.items():
        sensors.sort(key=lambda sensor: -sensor.message_rate_hz)
        names = [f"{vehicle_name}/{sensor.name}" for sensor in sensors]
        module = modules[names[0]] if len(names) == 1 else SHARED_MODULE
        process = f"{vehicle_name}/{'+'.join(sensor.name for sensor in sensors)}"
        found[process] = ["-m", module, *(word for name in names for word in ("--name", name))]
    return found


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
