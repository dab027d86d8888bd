# SPDX-License-Identifier: Apache-2.0
"""Command lines of the processes of a run. Services are started as ``python -m`` only."""

import socket
from collections.abc import Collection
from pathlib import Path

from groundlink.bus.core_topics import GATEWAY, PHYSICS, RECORDER
from groundlink.bus.topics import process_names
from groundlink.core.atomic_file import check_new_file
from groundlink.core.extras import check_installed
from groundlink.scenario import Scenario

SENSORS = "sensors"
"""Name of the shared process of all sensors."""


def commands(
    scenario: Scenario, file: str, run: str, endpoint: str, *, sensors_together: bool = False
) -> dict[str, list[str]]:
    """Return the command line of every process of a run; sensors may share one process."""
    found = {}
    modules = process_names(scenario)
    if sensors_together and (names := scenario.sensor_names()):
        modules = {n: m for n, m in modules.items() if n not in names}
        modules[SENSORS] = "services.sensors"
    for name, module in modules.items():
        arguments = [file] if name == "physics" else ["--name", name] if "/" in name else []
        found[name] = ["-m", module, *arguments, *joining(run, endpoint)]
    return found


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
    for name in scenario.sensor_names():
        if name in sensors:
            found[name] = ["-m", modules[name], "--name", name, *joined]
    return found


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
