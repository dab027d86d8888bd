# SPDX-License-Identifier: Apache-2.0
"""Supervision of real child processes."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from groundlink.core.errors import RunFailed
from groundlink.monitor.supervisor import Supervisor

SLEEP = ["-c", "import time; print('up', flush=True); time.sleep(60)"]
STUBBORN = [
    "-c",
    "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
    "print('up', flush=True); time.sleep(60)",
]


class Lines:
    """What children said."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, str]] = []

    def __call__(self, name: str, line: str) -> None:
        self.heard.append((name, line))

    def count(self, name: str, line: str) -> int:
        return self.heard.count((name, line))


@contextmanager
def running(commands: dict[str, list[str]], lines: Lines, **more: Any) -> Iterator[Supervisor]:
    """Start a supervisor and its children; stop them in the end."""
    supervisor = Supervisor(commands, lines, **more)
    supervisor.start()
    try:
        yield supervisor
    finally:
        supervisor.stop()


def poll_until(supervisor: Supervisor, condition: Callable[[], bool]) -> str | None:
    deadline = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        if name := supervisor.poll():
            return name
        time.sleep(0.02)
    return None


def test_crashed_child_is_restarted_and_others_continue() -> None:
    lines = Lines()
    with running({"a": SLEEP, "b": SLEEP}, lines) as supervisor:
        poll_until(supervisor, lambda: lines.count("a", "up") == lines.count("b", "up") == 1)
        victim, other = (supervisor.children[name].process for name in "ab")
        assert victim is not None
        assert other is not None
        killed = time.monotonic()
        os.kill(victim.pid, signal.SIGKILL)
        poll_until(supervisor, lambda: lines.count("a", "up") == 2)
        assert time.monotonic() - killed < 2.0
        assert supervisor.children["a"].restarts == 1
        assert supervisor.children["a"].last_exit == "SIGKILL"
        assert supervisor.children["b"].process is other
        assert other.poll() is None
        assert supervisor.stop() == []


def test_what_may_end_by_itself_is_done_then_and_others_are_restarted() -> None:
    lines = Lines()
    ends = ["-c", "print('worked', flush=True)"]
    with running({"a": ends, "b": ends}, lines, finite={"a"}) as supervisor:
        poll_until(supervisor, lambda: lines.count("b", "worked") == 2)
        assert supervisor.children["a"].is_done
        assert lines.count("a", "worked") == 1
        assert supervisor.children["a"].restarts == 0


@pytest.mark.parametrize("code", [2, 3, 4])
def test_what_a_user_has_to_mend_is_not_restarted(code: int) -> None:
    lines = Lines()
    tells = ["-c", f"import sys; print('mend me', file=sys.stderr); sys.exit({code})"]
    with running({"a": tells}, lines) as supervisor:
        assert poll_until(supervisor, lambda: False) == "a"
    assert lines.heard == [("a", "mend me")]
    assert supervisor.children["a"].ended_run is (code == RunFailed.exit_code)


def test_where_a_machine_lacks_something_the_others_go_on() -> None:
    lines = Lines()
    lacking = ["-c", "import sys; print('no EGL', file=sys.stderr); sys.exit(3)"]
    with running({"a": lacking, "b": SLEEP}, lines, dispensable={"a"}) as supervisor:
        assert poll_until(supervisor, lambda: len(lines.heard) == 3) is None
        skipped = "skipped; the run continues without it"
        assert set(lines.heard) == {("a", "no EGL"), ("a", skipped), ("b", "up")}
        assert supervisor.children["a"].last_exit == "skipped"
        assert supervisor.poll() is None
        assert supervisor.children["a"].process is None


def test_a_child_that_crashes_at_every_start_is_given_up() -> None:
    with running({"a": ["-c", "raise SystemExit(1)"]}, Lines()) as supervisor:
        assert poll_until(supervisor, lambda: False) == "a"
    assert supervisor.children["a"].restarts == 4


class Clock:
    """Stands in for the supervisor's `time`."""

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now


def crash(supervisor: Supervisor, clock: Clock, after: float) -> float:
    """Let the child run for so long and crash; return the delay until it was started again."""
    child = supervisor.children["a"]
    assert child.process is not None
    clock.now += after
    child.process.kill()
    child.process.wait()
    assert supervisor.poll() is None
    crashed = clock.now
    assert child.restart_at is not None
    while child.process is None:
        clock.now = max(clock.now, child.restart_at)
        supervisor.poll()
    return clock.now - crashed


def test_restarts_come_later_after_each_false_start_and_at_once_after_a_steady_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, lines = Clock(), Lines()
    monkeypatch.setattr("groundlink.monitor.supervisor.time", clock)
    with running({"a": ["-c", "import time; time.sleep(60)"]}, lines) as supervisor:
        delays = [crash(supervisor, clock, 1.0) for _ in range(4)]
        assert delays == pytest.approx([0.2, 0.4, 0.8, 1.5])
        assert crash(supervisor, clock, 10.1) == pytest.approx(0.2)
        assert [crash(supervisor, clock, 1.0) for _ in range(3)] == pytest.approx([0.4, 0.8, 1.5])
        for _ in range(10):
            assert crash(supervisor, clock, 10.1) == pytest.approx(0.2)
        assert supervisor.children["a"].restarts == 18
        told = [line for _, line in lines.heard]
        assert told[:2] == [f"ended with SIGKILL; restarting in {s} s" for s in ("0.2", "0.4")]


def test_a_child_that_does_not_end_is_killed() -> None:
    lines = Lines()
    supervisor = Supervisor({"good": SLEEP, "stubborn": STUBBORN}, lines)
    supervisor.start()
    poll_until(supervisor, lambda: len(lines.heard) == 2)
    asked = time.monotonic()
    assert supervisor.stop() == ["stubborn"]
    assert time.monotonic() - asked < 2.0


def test_no_child_outlives_a_killed_supervisor() -> None:
    """A child that runs already: one that still has to write would end by the closed pipe."""
    program = (
        "import time\n"
        "from groundlink.monitor.supervisor import Supervisor\n"
        "def log(name, line): print(s.children[name].pid, flush=True)\n"
        f"s = Supervisor({{'a': {SLEEP!r}}}, log)\n"
        "s.start(); time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout
        child = int(parent.stdout.readline())
        parent.kill()
    deadline = time.monotonic() + 5
    while Path(f"/proc/{child}/exe").exists():
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            raise AssertionError("the child is still running")
        time.sleep(0.02)
