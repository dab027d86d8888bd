# SPDX-License-Identifier: Apache-2.0
"""Recordings of a scenario with changed fields, each by a process of its own, and their checks."""

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from groundlink.loader.overrides import FieldChange
from groundlink.monitor.process_commands import free_endpoint
from groundlink.monitor.supervisor import end_with_parent

INTERRUPTED = 130

Case = tuple[FieldChange, ...]
"""The changed fields of a run."""


def record_case(scenario: str, case: Case, recording: Path, duration: str | None) -> int:
    """Record a scenario with changed fields; return the exit code.

    Errors are printed, the tables of `record` are not.

    Parameters
    ----------
    scenario
        name or file.
    recording
        file to write.
    duration
        sim time, s; None: that of `record`.
    """
    words = record_command(scenario, case, recording, duration)
    if sys.stderr.isatty():
        words.append("--json")  # draws its progress bar on stderr
    return exit_code(words, stdout=subprocess.DEVNULL)


def record_command(
    scenario: str, case: Case, recording: Path, duration: str | None, *, over_link: bool = False
) -> list[str]:
    """Return the command line that records a case, as `record_case` takes it."""
    words = ["record", scenario, "--out", str(recording), "--listen", free_endpoint()]
    words += ["--duration", duration] if duration else []
    words += ["--over-link"] if over_link else []
    words += [word for change in case for word in ("--set", change.text)]
    return [sys.executable, "-m", "groundlink", *words]


def check_recording(command: str, recording: Path) -> tuple[str, int]:
    """Run a shell command on a recording, its last argument; return its last line and exit code."""
    return run_in_shell(command, str(recording))


def run_in_shell(command: str, *arguments: str, folder: Path | None = None) -> tuple[str, int]:
    """Run a shell command in a process group, of which no process is left afterwards.

    Parameters
    ----------
    arguments
        further arguments of the command.
    folder
        working directory; None: that of this process.

    Returns
    -------
    The last line that it printed, `-` for none, and its exit code.
    """
    with subprocess.Popen(
        ["/bin/sh", "-c", f'{command} "$@"', "sh", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
        preexec_fn=end_with_parent,
    ) as process:
        try:
            printed, _ = process.communicate()
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    return (printed.strip().splitlines() or ["-"])[-1], process.returncode


def exit_code(
    command: Sequence[str],
    *,
    stdout: int | None = None,
    env: Mapping[str, str] | None = None,
) -> int:
    """Run a command; return its exit code, also after Ctrl-C, which reaches it as well."""
    try:
        return subprocess.run(
            command, stdout=stdout, env=env, check=False, preexec_fn=end_with_parent
        ).returncode
    except KeyboardInterrupt:
        return INTERRUPTED
