# SPDX-License-Identifier: Apache-2.0
"""Processes of one machine: started, watched, restarted when they crash, ended together.

Rule: knows commands and exit codes and nothing of what the processes do. A child that exits with 2
has told the user what to mend, one with 3 what this machine lacks, one with 4 why it ends the run;
none of them is restarted, nor is one that crashes at every start. No child outlives the supervisor,
whatever ends it.
"""

from __future__ import annotations

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
"""Between a crash and the restart; it doubles with each crash within `STEADY_SECONDS`."""

STEADY_SECONDS = 10.0
MAX_RESTART_SECONDS = 1.5

MAX_FALSE_STARTS = 5
"""A child that has crashed this often in a row without a steady time between is given up."""

END_SECONDS = 1.2
"""How long children may take to end by themselves before they are killed."""

TOLD = (UserError.exit_code, RequirementError.exit_code, RunFailed.exit_code)
"""Exit codes of a child that has said in a line why it ends."""

_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """Ask the kernel to kill this child when the supervisor is gone (prctl(2))."""
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
    """Exit code of the last crash; minus the signal's number where one ended it."""

    ended_run: bool = False
    """It has ended the run, as its scenario has it, and has said why."""

    is_left_out: bool = False
    """This machine lacks what it needs, and the others go on without it."""

    is_done: bool = False
    """It may end by itself, and has done so."""

    _reader: threading.Thread | None = field(default=None, repr=False)

    @property
    def pid(self) -> int | None:
        """Its process id; None while it is not there."""
        return self.process.pid if self.process else None


class Supervisor:
    """Keeps a set of processes running.

    Parameters
    ----------
    commands
        argument lists after the Python interpreter, by process name.
    say
        called with a process's name and a line that it printed; from several threads.
    finite
        names of processes that end by themselves, with 0, when their work is done.
    dispensable
        names of processes without which the others go on where this machine lacks what they need.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        say: Callable[[str, str], None],
        *,
        finite: Collection[str] = (),
        dispensable: Collection[str] = (),
    ) -> None:
        self.children = {name: Child(name, command) for name, command in commands.items()}
        self._finite, self._dispensable = frozenset(finite), frozenset(dispensable)
        self._say = say

    def start(self) -> None:
        """Start every process, in order. Must be called in the main thread."""
        for child in self.children.values():
            self._start(child)

    def tend(self) -> str | None:
        """Restart what has crashed; return the name of a child that cannot run, or None."""
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
                child.process, child.last_exit, child.is_left_out = None, "left out", True
                self._say(child.name, "the others go on without it")
                continue
            self._crashed(child, code, now)
            if code in TOLD or child.false_starts == MAX_FALSE_STARTS:
                return child.name
        return None

    def stop(self) -> list[str]:
        """End every process; return the names of those that had to be killed."""
        running = [c for c in self.children.values() if c.process and c.process.poll() is None]
        for child in running:
            assert child.process
            child.process.terminate()
        deadline = time.monotonic() + END_SECONDS
        killed = []
        for child in running:
            assert child.process
            try:
                child.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
                killed.append(child.name)
        for child in self.children.values():
            if child._reader:
                child._reader.join(0.2)
        return killed

    def _start(self, child: Child) -> None:
        # A session of its own: Ctrl-C reaches the supervisor alone, which ends all in order.
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
                self._say(name, line.rstrip())

    def _crashed(self, child: Child, code: int, now: float) -> None:
        steady = now - child.started > STEADY_SECONDS
        child.false_starts = 1 if steady else child.false_starts + 1
        child.delay = min(RESTART_SECONDS * 2 ** (child.false_starts - 1), MAX_RESTART_SECONDS)
        child.last_exit = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        child.code = code
        child.ended_run = code == RunFailed.exit_code
        child.restart_at = now + child.delay
        child.process = None
        if code not in TOLD:
            self._say(child.name, f"ended with {child.last_exit}; restart in {child.delay:g} s")
