# SPDX-License-Identifier: Apache-2.0
"""Containers of the default scenario on a real engine, and containers that observe them."""

import json
import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from msgspec import structs

from groundlink.bus.core_topics import GATEWAY, HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import Health
from groundlink.process.joining import join
from tests.system.rig import REPOSITORY, wait_for

PROJECT = "groundlink-test"

HOST = "127.74.47.1"
"""An address of this machine that nobody else listens at."""

UP_SECONDS = 90

ALL = {"container": ["-a"], "network": [], "volume": []}
"""What shows those that are stopped, too."""

Seen: TypeAlias = dict[str, tuple[int, int]]
"""By topic, how many messages have come and the stamp of the last one, in nanoseconds."""


def docker(*words: str, check: bool = True, seconds: float = 60) -> str:
    """Return what `docker` prints."""
    done = subprocess.run(
        ["docker", *words],
        cwd=REPOSITORY,
        env=os.environ | {"GROUNDLINK_PUBLISH": HOST},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    assert done.returncode == 0 or not check, f"docker {' '.join(words)}: {done.stderr}"
    return done.stdout


def needs_docker() -> None:
    """Skip where no engine or no Compose answers."""
    for words in (["version"], ["compose", "version"]):
        if (
            shutil.which("docker")
            and not subprocess.run(["docker", *words], capture_output=True, check=False).returncode
        ):
            continue
        pytest.skip(f"`docker {' '.join(words)}` does not answer")


class Stack:
    """A Compose project that is up."""

    endpoint = f"tcp/{HOST}:7447"
    """Where its router is reached from this machine."""

    def __init__(self, files: Sequence[str]) -> None:
        self._files = [word for file in files for word in ("-f", file)]

    def compose(self, *words: str, seconds: float = 120, check: bool = True) -> str:
        return docker("compose", "-p", PROJECT, *self._files, *words, seconds=seconds, check=check)

    def containers(self) -> dict[str, dict[str, Any]]:
        """Return what Compose knows of each service's container."""
        lines = self.compose("ps", "-a", "--format", "json").splitlines()
        return {row["Service"]: row for row in map(json.loads, lines)}

    def name(self, service: str) -> str:
        return f"{PROJECT}-{service}-1"

    def crash(self, service: str) -> None:
        """Kill all that runs in a container, from inside."""
        docker("exec", self.name(service), "sh", "-c", "kill -9 -1", check=False)

    def starts(self) -> dict[str, str]:
        """Return when each container was started last."""
        names = [self.name(service) for service in self.containers()]
        lines = docker("inspect", "-f", "{{.Name}} {{.State.StartedAt}}", *names).split("\n")
        of_name = dict(line.removeprefix(f"/{PROJECT}-").split() for line in lines if line)
        return {name.removesuffix("-1"): begun for name, begun in of_name.items()}

    def streams(self) -> list[dict[str, Any]]:
        """Return what became of what the gateway has sent, by stream."""
        with Bus(connect=self.endpoint) as bus:
            run, _ = join(bus, None, threading.Event())
            beats: BusInbox[Health] = BusInbox(depth=1)
            bus.subscribe(HEALTH.key_in(run, process=GATEWAY), Health, beats)
            beat = wait_for(lambda: beats.get(seconds=0.1), 10, "the gateway is well")
        return [structs.asdict(row) for row in beat[1].streams if row.direction == "to ROS"]

    @contextmanager
    def cut_off(self, service: str, network: str = "bus") -> Iterator[None]:
        """Take a container off a network for a while."""
        net = f"{PROJECT}_{network}"
        docker("network", "disconnect", net, self.name(service))
        try:
            yield
        finally:
            docker("network", "connect", "--alias", service, net, self.name(service))

    def lose_all(self, service: str, seconds: float) -> None:
        """Lose every packet between a container and the router for so long.

        Unlike `cut_off`, it takes no longer on a busy machine. Until 6 s, TCP takes its link up
        again; later, both ends give it up, not at the same time, and what is published on a link
        that only one of them has begun anew is lost and told by nobody.
        """
        rows = [("router", "-s", self._address(service)), (service, "-s", self._address("router"))]
        for step in ("-I", "-D"):
            for within, *match in rows:
                pid = docker("inspect", "-f", "{{.State.Pid}}", self.name(within)).strip()
                words = ["nsenter", "-t", pid, "-n", "iptables", step, "INPUT", *match]
                subprocess.run([*words, "-j", "DROP"], check=True)
            if step == "-I":
                time.sleep(seconds)

    def _address(self, service: str) -> str:
        format_ = "{{range .NetworkSettings.Networks}}{{.IPAddress}} {{end}}"
        return docker("inspect", "-f", format_, self.name(service)).split()[0]


@contextmanager
def up(*files: str) -> Iterator[Stack]:
    """Bring the stack up, healthy; afterwards nothing of it is left."""
    stack = Stack(files or ["compose.yaml"])
    stack.compose("down", "-v", "--remove-orphans")
    stack.compose("build", "-q", seconds=600)
    try:
        stack.compose("up", "-d", "--wait", "--wait-timeout", str(UP_SECONDS), seconds=150)
        yield stack
    finally:
        stack.compose("down", "-v", "--remove-orphans", "-t", "3")


class Observer:
    """A subscriber in another container, on the network of ROS alone."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            [
                *("docker", "run", "--rm", "--init", "--name", f"{PROJECT}-observer"),
                *("--network", f"{PROJECT}_ros"),
                *("-e", "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", "-e", "HOME=/tmp"),
                *("-e", "FASTDDS_BUILTIN_TRANSPORTS=UDPv4?sockets_size=4MB"),
                *("-v", f"{Path(__file__).with_name('observer.py')}:/observer.py:ro"),
                *("--entrypoint", "python", "groundlink-ros2", "/observer.py"),
            ],
            stdin=subprocess.DEVNULL,
            stdout=self._file.fileno(),
        )
        self._seen: Seen = {}

    def look(self) -> Seen:
        """Return what has come so far."""
        size = os.fstat(self._file.fileno()).st_size
        rows = os.pread(self._file.fileno(), size, 0).splitlines(keepends=True)
        if whole := [row for row in rows if row.endswith(b"\n")]:
            self._seen = json.loads(whole[-1])["seen"]
        return self._seen

    def rates(self, seconds: float) -> dict[str, float]:
        """Return messages a second of sim time, by topic, over the next seconds."""
        before = self.look()
        time.sleep(seconds)
        after = self.look()
        return {
            topic: (count - before[topic][0]) * 1e9 / max(1, stamp - before[topic][1])
            for topic, (count, stamp) in after.items()
            if topic in before
        }

    def waits_for(self, condition: Callable[[Seen], bool], seconds: float) -> float:
        """Return after how many seconds a condition holds of what has come; fail if never."""
        begun = time.monotonic()
        while time.monotonic() - begun < seconds:
            if condition(self.look()):
                return time.monotonic() - begun
            time.sleep(0.1)
        raise AssertionError(f"not within {seconds} s; last seen {self.look()}")

    def close(self) -> None:
        docker("rm", "-f", f"{PROJECT}-observer", check=False)
        self._process.wait(30)
        self._file.close()
