# SPDX-License-Identifier: Apache-2.0
"""Rig for a run with a certificate-protected bus, and participants with foreign certificates."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh

from groundlink.bus.credentials import VARIABLE, Credentials
from groundlink.process.runner import ROUTER_VARIABLE

from .rig import REPOSITORY, Rig


class Secured:
    """A rig's run with credentials of its own."""

    def __init__(self, it: Rig, scenario: Path | None = None) -> None:
        self.rig, self.folder = it, it.folder / "secure"
        self.scenario = scenario or it.scenario
        self.key_file = str(self.folder / "bridge.key")
        it.endpoint = it.endpoint.replace("tcp/", "tls/")
        it.environment[ROUTER_VARIABLE] = it.endpoint
        self.make(self.folder)

    def make(self, folder: Path) -> None:
        """Make credentials, with another authority each time."""
        command = [sys.executable, "-m", "groundlink", "secure", str(self.scenario), str(folder)]
        subprocess.run(command, check=True, cwd=REPOSITORY, timeout=60)

    def of(self, process: str, folder: Path | None = None) -> Path:
        """Return a process's folder."""
        return (folder or self.folder) / process.replace("/", "-")

    def start(self, process: str, *command: str, own: Path | None = None) -> subprocess.Popen[str]:
        """Start a process with its credentials, or with those in another folder."""
        through = ("env", f"{VARIABLE}={own or self.of(process)}")
        log = f"{process.replace('/', '_')}.log"
        return self.rig.start("-m", *command, log=log, through=through)

    def say(self, *command: str, own: Path | str | None = None) -> subprocess.CompletedProcess[str]:
        """Run a command to its end, as the operator, with a folder, or with ``""`` for none."""
        return subprocess.run(
            [sys.executable, "-m", *command],
            cwd=REPOSITORY,
            env=self.rig.environment | {VARIABLE: str(self.of("operator") if own is None else own)},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    @contextmanager
    def session(self, process: str) -> Iterator[zenoh.Session]:
        """Open a bare session with a process's credentials: what our own programs never do."""
        configuration = zenoh.Config()
        settings = Credentials(self.of(process)).settings() | {
            "mode": "client",
            "connect/endpoints": [self.rig.endpoint],
            "connect/timeout_ms": 3000,
            "connect/exit_on_failure": True,
            "scouting/multicast/enabled": False,
        }
        for key, value in settings.items():
            configuration.insert_json5(key, json.dumps(value))
        session = zenoh.open(configuration)
        try:
            yield session
        finally:
            session.close()  # type: ignore[no-untyped-call]


class Heard:
    """What a session gets to hear of some keys."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.keys: list[str] = []
        self._lock = threading.Lock()
        session.declare_subscriber(key, self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        with self._lock:
            self.keys.append(str(sample.key_expr))

    def wait(self, seconds: float) -> list[str]:
        """Return the keys that were heard within so long."""
        time.sleep(seconds)
        return self.keys
