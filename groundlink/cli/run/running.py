# SPDX-License-Identifier: Apache-2.0
"""What commands share that start the processes of a run here: how each process is started.

Rule: services are started only as ``python -m``. Nothing is started here; see `supervised`.
"""

from __future__ import annotations

import importlib.util
import socket
from ipaddress import ip_address
from pathlib import Path

from rich.console import Console

from groundlink.bus import core_topics
from groundlink.bus.session import DEFAULT_ENDPOINT
from groundlink.bus.topics import process_names
from groundlink.core.errors import RequirementError, UserError
from groundlink.process.runner import address
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import Gateway

RECORDER = core_topics.RECORDER

ROS_SIDE = "ros"
"""Name of the process that receives on the ROS side."""

SENSORS = "sensors"
"""Name of the process of all sensors where they share one."""

SCENARIO_HELP = "scenario file (YAML), or the name of a shipped scenario such as indoor_lab"

LISTEN_HELP = "where the run's router listens for its processes and for others (%(default)s)"

LISTEN_DEFAULT = DEFAULT_ENDPOINT


def commands(
    scenario: Scenario, file: str, run: str, endpoint: str, *, sensors_together: bool = False
) -> dict[str, list[str]]:
    """Return the command of every process of a run; sensors may share one."""
    found = {}
    modules = process_names(scenario)
    if sensors_together and (names := scenario.sensor_names()):
        modules = {n: m for n, m in modules.items() if n not in names}
        modules[SENSORS] = "services.sensors"
    for name, module in modules.items():
        arguments = [file] if name == "physics" else ["--name", name] if "/" in name else []
        found[name] = ["-m", module, *arguments, *joining(run, endpoint)]
    return found


def free_endpoint() -> str:
    """Return an endpoint at which nobody listens: other runs may go on beside this one."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def joining(run: str, endpoint: str) -> list[str]:
    """Return the arguments by which a process joins a run."""
    return ["--connect", endpoint, "--run", run]


def recorder(out: str, run: str, endpoint: str) -> list[str]:
    """Return the command of a recorder.

    Raises
    ------
    RequirementError
        when a package of the extra `record` is not installed; a run would wait for its recorder.
    """
    for package in ("mcap", "rosbags", "zstandard"):
        if importlib.util.find_spec(package) is None:
            raise RequirementError(
                f"the Python package `{package}` is not installed. "
                "Fix: pip install 'groundlink[record]'"
            )
    return ["-m", "services.recorder", "--out", out, *joining(run, endpoint)]


def check_new_file(option: str, path: Path) -> None:
    """Refuse to write where there is a file already, or no folder.

    Raises
    ------
    UserError
        when it is so.
    """
    if path.exists():
        raise UserError(f"{option} {path}: it exists already; delete it or choose another name")
    if not path.resolve().parent.is_dir():
        raise UserError(f"{option} {path}: there is no folder {path.parent}")


def ros_side(gateway: Gateway, shown: Console) -> list[str]:
    """Return the command that receives at the gateway's peer: the ROS 2 node where ROS is."""
    bind = ["--bind", gateway.peer]
    receives, sends = (address(text)[0] for text in (gateway.peer, gateway.bind))
    if not ip_address(receives).is_loopback:
        # What is bound to all addresses sends to one of its own host from that address.
        bind += ["--peer", f"{receives if ip_address(sends).is_unspecified else sends}:0"]
    key = {"--key-file": gateway.key_file, "--key-env": gateway.key_env}
    bind += [word for name, value in key.items() if value is not None for word in (name, value)]
    if importlib.util.find_spec("rclpy") and importlib.util.find_spec("udp_bridge_ros2"):
        return ["-m", "udp_bridge_ros2", *bind]
    if importlib.util.find_spec("udp_bridge") is None:
        raise RequirementError(
            "the Python package `udp_bridge` is not installed. Fix: pip install "
            "'groundlink[gateway]', or start without a ROS side: --no-ros"
        )
    shown.print("no ROS 2 in this environment: a plain receiver stands in for the ROS node")
    return ["-m", "udp_bridge", "listen", *bind, "--report", "--quiet"]
