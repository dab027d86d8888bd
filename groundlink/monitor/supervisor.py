# SPDX-License-Identifier: Apache-2.0
"""Supervisor: start processes on this machine, restart them after a crash, stop them together.

Not restarted are children that exit with an explained error (2: fix by the user, 3: this machine
lacks something, 4: the scenario ended the run) and children that crash at every start. No child
outlives the supervisor.
"""

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from groundlink.core.errors import RequirementError, RunFailed, UserError

RESTART_SECONDS = 0.2
"""Delay of a restart; doubles with each crash within `STEADY_SECONDS`."""

STEADY_SECONDS = 10.0
MAX_RESTART_SECONDS = 1.5

MAX_FALSE_STARTS = 5
"""Limit of consecutive crashes without `STEADY_SECONDS` in between."""

END_SECONDS = 1.2
"""Timeout for a clean exit before a child is killed."""

EXPLAINED = (UserError.exit_code, RequirementError.exit_code, RunFailed.exit_code)
"""Exit codes of a child that has printed the reason as one line."""

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """Have the kernel kill this child when the supervisor dies (prctl(2))."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


@dataclass
class Child:
    """One supervised process."""

    name: str
    command: Sequence[str]
    process: subprocess.Popen[str] | None = None
    restarts: int = 0
    started: float = 0.0
    restart_at: float | None = None
    delay: float = RESTART_SECONDS
    false_starts: int = 0
    last_exit: str = ""
    code: int = 0
    """Exit code of the last crash; the negative signal number if a signal ended it."""

    ended_run: bool = False
    """Whether it ended the run because the scenario says so."""

    is_skipped: bool = False
    """Whether the run continues without it because this machine lacks something."""

    is_done: bool = False
    """Whether a finite process has ended."""

    _reader: threading.Thread | None = field(default=None, repr=False)

    @property
    def pid(self) -> int | None:
        """Process id; None while it is not running."""
        return self.process.pid if self.process else None


class Supervisor:
    """Keeps a set of processes running.

    Parameters
    ----------
    commands
        argument lists after the Python interpreter, by process name.
    log
        called with a process name and a line of its output, from several threads.
    finite
        names of processes that end by themselves with exit code 0.
    dispensable
        names of processes without which the run continues if this machine lacks something.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        log: Callable[[str, str], None],
        *,
        finite: Collection[str] = (),
        dispensable: Collection[str] = (),
    ) -> None:
        self.children = {name: Child(name, command) for name, command in commands.items()}
        self._finite, self._dispensable = frozenset(finite), frozenset(dispensable)
        self._log = log

    def start(self) -> None:
        """Start every process, in order. Must be called in the main thread."""
        for child in self.children.values():
            self._start(child)

    def not_running(self) -> list[str]:
        """Return the names of the processes that are not running at present."""
        children = self.children.values()
        return [c.name for c in children if c.process is None or c.process.poll() is not None]

    def poll(self) -> str | None:
        """Restart crashed children; return the name of a child that failed for good, or None."""
        now = time.monotonic()
        for child in self.children.values():
            if child.process is None:
                if child.restart_at is not None and now >= child.restart_at:
                    child.restarts += 1
                    self._start(child)
                continue
            code = child.process.poll()
            if code is None:
                continue
            if code == 0 and child.name in self._finite:
                child.process, child.is_done = None, True
                continue
            if code == RequirementError.exit_code and child.name in self._dispensable:
                child.process, child.last_exit, child.is_skipped = None, "skipped", True
                self._log(child.name, "skipped; the run continues without it")
                continue
            self._crashed(child, code, now)
            if code in EXPLAINED or child.false_starts == MAX_FALSE_STARTS:
                return child.name
        return None

    def stop(
        self, names: Collection[str] | None = None, *, seconds: float = END_SECONDS
    ) -> list[str]:
        """Stop the named processes, or all; return the names of those that had to be killed.

        Parameters
        ----------
        seconds
            timeout for their exit.
        """
        chosen = [c for c in self.children.values() if names is None or c.name in names]
        running = [c for c in chosen if c.process and c.process.poll() is None]
        for child in running:
            assert child.process
            child.process.terminate()
        deadline = time.monotonic() + seconds
        killed = []
        for child in running:
            assert child.process
            try:
                child.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
                killed.append(child.name)
        for child in chosen:
            if child._reader:
                child._reader.join(0.2)
        return killed

    def _start(self, child: Child) -> None:
        # In a new session Ctrl-C reaches only the supervisor, which stops the children in order.
        child.process = subprocess.Popen(
            [sys.executable, *child.command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            preexec_fn=end_with_parent,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        child.started = time.monotonic()
        child.restart_at = None
        child._reader = threading.Thread(target=self._pass_on, args=(child.name, child.process))
        child._reader.daemon = True
        child._reader.start()

    def _pass_on(self, name: str, process: subprocess.Popen[str]) -> None:
        assert process.stdout
        with process.stdout as lines:
            for line in lines:
                self._log(name, line.rstrip())

    def _crashed(self, child: Child, code: int, now: float) -> None:
        steady = now - child.started > STEADY_SECONDS
        child.false_starts = 1 if steady else child.false_starts + 1
        child.delay = min(RESTART_SECONDS * 2 ** (child.false_starts - 1), MAX_RESTART_SECONDS)
        child.last_exit = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        child.code = code
        child.ended_run = code == RunFailed.exit_code
        child.restart_at = now + child.delay
        child.process = None
        if code not in EXPLAINED:
            self._log(child.name, f"ended with {child.last_exit}; restarting in {child.delay:g} s")
