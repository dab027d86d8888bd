# SPDX-License-Identifier: Apache-2.0
"""A test's hand on a ROS node that calls services and actions, in a process of its own."""

import json
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

from .bodies import ROS_FOLDER


class Caller:
    """Starts the node, and ends it."""

    def __init__(self, environment: Mapping[str, str], node: str = "/udp_bridge") -> None:
        self._node = node
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.ros.caller"],
            cwd=ROS_FOLDER.parent,
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert self._line() == "ready"

    def call(self, name: str, kind: str, /, **request: Any) -> dict[str, Any]:
        """Call a service; return the fields of the response and what the clock shows."""
        return self._told({"service": f"{self._node}/{name}", "kind": kind, "request": request})

    def act(self, name: str, kind: str, *, cancel: bool = False, **goal: Any) -> dict[str, Any]:
        """Send a goal to an action; return the result's fields, status, feedback and clock."""
        whole = {"action": f"{self._node}/{name}", "kind": kind, "goal": goal, "cancel": cancel}
        return self._told(whole)

    def trigger(self, name: str) -> tuple[bool, str]:
        """Call a Trigger."""
        answer = self.call(name, "std_srvs/srv/Trigger")
        return bool(answer["success"]), str(answer["message"])

    def clock_nanos(self) -> int:
        return int(self._told({})["clock"])

    def close(self) -> None:
        assert self.process.stdin
        assert self.process.stdout
        self.process.stdin.close()
        self.process.wait(20)
        self.process.stdout.close()

    def _told(self, wanted: dict[str, Any]) -> dict[str, Any]:
        assert self.process.stdin
        self.process.stdin.write(json.dumps(wanted) + "\n")
        self.process.stdin.flush()
        answer: dict[str, Any] = json.loads(self._line())
        return answer

    def _line(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline().strip()
