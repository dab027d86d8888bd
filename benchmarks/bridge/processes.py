# SPDX-License-Identifier: Apache-2.0
"""Processes of a measurement: controlled by lines, unprivileged, and always ended.

`drop_privileges` removes the right to exceed the system's limit on receive buffers, so that the
results hold for any user.
"""

import ctypes
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

TIMEOUT_S = 30.0
"""Longest time for a line; exceeded only if a message was lost."""
_END_S = 5.0
_PR_SET_PDEATHSIG = 1
_PR_CAPBSET_DROP = 24
CAP_NET_ADMIN = 12
_prctl = ctypes.CDLL(None).prctl


class ProcessFailed(RuntimeError):
    """A process ended or wrote an unexpected line."""


class TimedOut(ProcessFailed):
    """A process is running, but wrote no line in time."""


def drop_privileges() -> None:
    """Remove CAP_NET_ADMIN from all child processes and set a ROS domain for them."""
    # Without CAP_SETPCAP it fails, but then there is nothing to take either.
    _prctl(_PR_CAPBSET_DROP, CAP_NET_ADMIN, 0, 0, 0)
    # The ports of the domains below 101 lie below those that the kernel hands out.
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)


def _end_with_parent() -> None:
    """End the child with this process, even if it is killed; runs in the child before `exec`."""
    _prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


class LineProcess:
    """A process controlled by lines on its standard input and output."""

    def __init__(self, *command: str, environment: Mapping[str, str] | None = None) -> None:
        self._errors = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            command,
            bufsize=0,
            env={**os.environ, **(environment or {})},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            preexec_fn=_end_with_parent,
        )
        self._read = b""

    def say(self, line: str) -> None:
        """Write a line to the process."""
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")

    def number(self, timeout_s: float = TIMEOUT_S) -> int:
        """Wait for the process's next line, a number.

        Raises
        ------
        TimedOut
            When it does not come in time.
        ProcessFailed
            When the process has ended.
        """
        assert self._process.stdout is not None
        end = time.monotonic() + timeout_s
        while b"\n" not in self._read:
            rest = max(0.0, end - time.monotonic())
            ready, _, _ = select.select([self._process.stdout], [], [], rest)
            more = os.read(self._process.stdout.fileno(), 1 << 16) if ready else b""
            if not more:
                self._errors.seek(0)
                said = self._errors.read().decode(errors="replace")[-2000:]
                why = f"no answer from {self._process.args!r}; its last words: {said}"
                raise ProcessFailed(why) if ready else TimedOut(why)
            self._read += more
        line, _, self._read = self._read.partition(b"\n")
        return int(line)

    def spent_nanos(self) -> int:
        """Return the processor time that all threads of the process have taken so far."""
        tasks = Path(f"/proc/{self._process.pid}/task").iterdir()
        return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks)

    def close(self) -> None:
        """Ask the process to end, and end it if it does not."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for file in (self._process.stdin, self._process.stdout, self._errors):
            assert file is not None
            file.close()


def python(module: str, *words: str, environment: Mapping[str, str] | None = None) -> LineProcess:
    """Start a module as a process."""
    return LineProcess(sys.executable, "-m", module, *words, environment=environment)


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Let processes compute beside."""
    with ExitStack() as stack:
        for _ in range(count):
            busy = LineProcess(sys.executable, "-c", "while True: pass")
            stack.callback(busy.close)
        yield
