# SPDX-License-Identifier: Apache-2.0
"""Rig of system tests: real processes, free ports, private names, and cleanup."""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from groundlink.monitor.supervisor import end_with_parent
from tests.ros_domains import next_domain

REPOSITORY = Path(__file__).resolve().parents[2]
LAB = REPOSITORY / "scenarios" / "indoor_lab.yaml"
"""The default scenario."""


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def is_answered(address: tuple[str, int]) -> bool:
    """Return whether somebody listens at an address."""
    with socket.socket() as probe:
        return probe.connect_ex(address) == 0


def wait_for(condition: Callable[[], Any], seconds: float, what: str) -> Any:
    """Return the condition's first true value; fail the test when none comes in time."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.05)
    raise AssertionError(f"within {seconds} s: {what}")


def without_camera(scenario: str) -> str:
    """Return the text of the default scenario without its camera, the last of its sensors."""
    before, camera, after = scenario.partition("      - {kind: camera,")
    assert camera
    return before + after[after.index("}\n") + 2 :]


class Rig:
    """Ports and names of one run, and the processes that were started for it.

    The run is that of the default scenario, without its camera where that is not asked for: it
    takes half a core, which other tests need not spend.
    """

    def __init__(self, folder: Path, *, time_section: str = "", camera: bool = False) -> None:
        self.folder = folder
        self.bind = ("127.0.0.1", free_port())
        self.peer = ("127.0.0.1", free_port())
        self.endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        self.run = f"test_{os.getpid()}_{random.randrange(10**6)}"
        self.environment = os.environ | {
            "ROS_DOMAIN_ID": next_domain(),
            "PYTHONUNBUFFERED": "1",
        }
        self.scenario = folder / "scenario.yaml"
        scenario = LAB.read_text(encoding="utf-8")
        self.scenario.write_text(
            (scenario if camera else without_camera(scenario))
            + f"\ngateway: {{bind: 127.0.0.1:{self.bind[1]}, peer: 127.0.0.1:{self.peer[1]}}}\n"
            + time_section,
            encoding="utf-8",
        )
        self.started: list[subprocess.Popen[str]] = []

    def start(self, *command: str, log: str, through: Sequence[str] = ()) -> subprocess.Popen[str]:
        """Start a Python process whose output goes to a file of this name.

        `through` are the words of a program that becomes it, such as `env` or `nsenter`.
        """
        with (self.folder / log).open("w", encoding="utf-8") as output:
            process = subprocess.Popen(
                [*through, sys.executable, *command],
                cwd=REPOSITORY,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )
        self.started.append(process)
        return process

    def up(self, *more: str) -> subprocess.Popen[str]:
        """Start `groundlink up` with this rig's scenario."""
        return self.start(
            *("-m", "groundlink", "up", str(self.scenario)),
            *("--run", self.run, "--listen", self.endpoint, *more),
            log="up.log",
        )

    def is_answered(self) -> bool:
        """Return whether somebody listens at the endpoint."""
        return is_answered(("127.0.0.1", int(self.endpoint.rpartition(":")[2])))

    @staticmethod
    def address(pair: tuple[str, int]) -> str:
        return f"{pair[0]}:{pair[1]}"

    def log(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")

    def stop(self) -> None:
        for process in self.started:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self.started:
            try:
                process.wait(5)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()


@contextmanager
def rig(folder: Path, *, time_section: str = "", camera: bool = False) -> Iterator[Rig]:
    it = Rig(folder, time_section=time_section, camera=camera)
    try:
        yield it
    finally:
        it.stop()


class Observer:
    """A real rclpy node in a process of its own, which writes down what arrives."""

    def __init__(
        self,
        rig: Rig,
        module: str = "tests.system.ros_observer",
        *,
        through: Sequence[str] = (),
    ) -> None:
        self._file = rig.folder / "observed.jsonl"
        self._file.touch()
        self._position = 0
        self.messages: dict[str, list[dict[str, Any]]] = {}
        words = ("-m", module, str(self._file))
        self.process = rig.start(*words, log="observer.log", through=through)

    def read(self) -> dict[str, list[dict[str, Any]]]:
        """Return all that has arrived so far, by topic."""
        with self._file.open(encoding="utf-8") as file:
            file.seek(self._position)
            for line in iter(file.readline, ""):
                if not line.endswith("\n"):
                    break
                self._position += len(line)
                message = json.loads(line)
                self.messages.setdefault(message["topic"], []).append(message)
        return self.messages

    def count(self, topic: str) -> int:
        return len(self.read().get(topic, ()))

    def wait(self, topic: str, *, beyond: int, seconds: float) -> None:
        """Wait until more than so many messages of a topic have arrived."""
        wait_for(lambda: self.count(topic) > beyond, seconds, f"{topic} arrives in ROS")


def children_of(pid: int) -> dict[int, str]:
    """Return the command lines of a process's children, by process id."""
    children = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text(encoding="utf-8", errors="replace")
                command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            except OSError:
                continue
            if int(stat.rpartition(")")[2].split()[1]) == pid:
                children[int(entry.name)] = command
    return children
