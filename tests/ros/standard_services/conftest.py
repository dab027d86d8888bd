# SPDX-License-Identifier: Apache-2.0
"""The standard's services without ROS: callbacks, messages, and a stand-in for the simulator."""

import json
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import pytest

from tests.ros.interfaces import simulation_interfaces
from udp_bridge.node.command_client import CommandFailed
from udp_bridge.wire.run_commands import (
    PAUSE,
    PAUSED,
    RESUME,
    RUNNING,
    STEP,
    RunCommandReply,
)

LAB = {"name": "lab", "uri": "worlds/lab", "description": "", "tags": []}


class Simulator:
    """A run and its physics: stands in for `RunCommandClient`."""

    def __init__(self) -> None:
        self.state = RUNNING
        self.tick = 40
        self.queries: list[dict[str, Any]] = []
        self.answers: dict[str, dict[str, Any] | Exception] = {"world": {"world": LAB}}
        """Answers by kind of query; all others are answered by nothing but the tick."""

    def call(self, action: int, ticks: int = 0) -> RunCommandReply:
        self.state = {PAUSE: PAUSED, RESUME: RUNNING}.get(action, self.state)
        self.tick += ticks if action == STEP else 0
        return RunCommandReply(1, self.state, self.tick)

    def ask(self, text: str) -> str:
        self.queries.append(json.loads(text))
        kind = self.queries[-1]["query"]
        if kind == "reset" and "time" in self.queries[-1]["scopes"]:
            self.tick = 0
        answer = self.answers.get(kind, {})
        if isinstance(answer, Exception):
            raise answer
        return json.dumps({"tick": self.tick, "stamp_nanos": 1_000_000_002, **answer})

    def refuse(self, kind: str, code: str, error: str = "no") -> None:
        self.answers[kind] = {"error": error, "code": code}

    def fail(self, kind: str) -> None:
        self.answers[kind] = CommandFailed("no gateway found")


class Served:
    """Calls services and the action as rclpy does."""

    def __init__(self, simulator: Simulator) -> None:
        from udp_bridge_ros2.standard_services.table import StandardServices

        self.simulator = simulator
        served = StandardServices(simulator)  # type: ignore[arg-type]
        self.services = {name: (kind, callback) for name, kind, callback in served.services()}
        self.actions = {name: callback for name, _, callback in served.actions()}

    def call(self, name: str, /, **fields: Any) -> Any:
        """Call a service; two underscores in a name lead into a field."""
        kind, callback = self.services[name]
        request = kind.Request()
        for path, value in fields.items():
            *owners, last = path.split("__")
            target = request
            for owner in owners:
                target = getattr(target, owner)
            setattr(target, last, value)
        return callback(request, kind.Response())

    def result(self, name: str, /, **fields: Any) -> tuple[int, str]:
        """Call a service; return the code and the text of its result."""
        found = self.call(name, **fields).result
        return found.result, found.error_message


@pytest.fixture(scope="session")
def messages(pytestconfig: pytest.Config) -> Iterator[Callable[..., Any]]:
    """Messages by name, of the standard's package, which only these tests import."""
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    folder = str(simulation_interfaces(pytestconfig.cache.mkdir("simulation_interfaces")))
    sys.path.insert(0, folder)
    standard = import_module("simulation_interfaces.msg")
    geometry = import_module("geometry_msgs.msg")

    def message(name: str, /, **fields: Any) -> Any:
        kind = getattr(standard, name, None) or getattr(geometry, name)
        return kind(**fields)

    yield message
    sys.path.remove(folder)


@pytest.fixture
def served(messages: Callable[..., Any]) -> Served:
    return Served(Simulator())
