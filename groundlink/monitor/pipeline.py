# SPDX-License-Identifier: Apache-2.0
"""Pipelines: processes of which each reads what the one before writes."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from groundlink.bus.pipe import PIPE_BYTES, PipedMessage, read_piped
from groundlink.core.errors import RequirementError, UserError
from groundlink.scenario import Scenario
from groundlink.scenario.sensor_kinds import kind_of

from .supervisor import end_with_parent

RUN = "resim"
"""Name of a repeated run, whose messages no other process sees."""


def repeated_physics(journal: Path, *, until_tick: int | None = None) -> list[str]:
    """Return the command line of the process that repeats a journal."""
    until = [] if until_tick is None else ["--until", str(until_tick)]
    return ["-m", "services.physics.repeat", "--run", RUN, "--follow", str(journal), *until]


def repeated_sensors(scenario: Scenario, sensors: Sequence[str], journal: Path) -> list[list[str]]:
    """Return the command lines of the processes of sensors of a journal's scenario.

    Sensors that see the world compute most, so each has a process of its own. All others share one.
    """
    together: list[str] = []
    alone: list[str] = []
    for name in sensors:
        pair = scenario.sensor(name)
        assert pair is not None
        (alone if kind_of(pair[1]).sees_world else together).append(name)
    groups = [[name] for name in alone] + ([together] if together else [])
    command = ["-m", "services.sensors.repeat", "--run", RUN, "--follow", str(journal)]
    return [[*command, *(word for name in group for word in ("--name", name))] for group in groups]


@contextmanager
def pipeline(
    commands: Sequence[Sequence[str]], source: IO[bytes] | None = None
) -> Iterator[Iterator[PipedMessage]]:
    """Start processes, yield the messages that the last one writes, and end the processes.

    Parameters
    ----------
    commands
        command lines of Python, from the first process to the last.
    source
        input of the first process, if any.

    Raises
    ------
    UserError
        when a process fails; it has printed why.
    """
    processes: list[subprocess.Popen[bytes]] = []
    end: IO[bytes] | int = source or subprocess.DEVNULL
    try:
        for command in commands:
            process = subprocess.Popen(
                [sys.executable, *command],
                stdin=end,
                stdout=subprocess.PIPE,
                pipesize=PIPE_BYTES,
                # Ctrl-C reaches only this process, which then ends the others.
                start_new_session=True,
                preexec_fn=end_with_parent,
            )
            if processes:
                before = processes[-1].stdout
                assert before is not None
                before.close()
            processes.append(process)
            assert process.stdout is not None
            end = process.stdout
        yield _messages(processes)
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()
            assert process.stdout is not None
            process.stdout.close()


def _messages(processes: Sequence[subprocess.Popen[bytes]]) -> Iterator[PipedMessage]:
    last = processes[-1].stdout
    assert last is not None
    yield from read_piped(last)
    for process in processes:
        process.wait()
        _check(process.args, process.returncode)


def write_output(command: Sequence[str], file: IO[bytes]) -> None:
    """Run a process that writes to a file.

    Raises
    ------
    UserError
        when it fails; it has printed why.
    """
    done = subprocess.run(
        [sys.executable, *command],
        stdin=subprocess.DEVNULL,
        stdout=file,
        preexec_fn=end_with_parent,
        check=False,
    )
    _check(done.args, done.returncode)


def _check(words: Any, code: int) -> None:
    """Check an exit code: an end by a signal follows from the failure of another process."""
    if code > 0:
        failed = RequirementError if code == RequirementError.exit_code else UserError
        raise failed(f"{words[words.index('-m') + 1]} failed; see its line above")
