# SPDX-License-Identifier: Apache-2.0
"""Command lines of the processes of a run. Services are started as ``python -m`` only."""

import socket

from groundlink.bus.topics import process_names
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
