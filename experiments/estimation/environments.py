# SPDX-License-Identifier: Apache-2.0
"""Virtual environments of external programs.

A file in the environment records what was installed; nothing is done if that is up to date.
"""

import ctypes
import shutil
import subprocess
import time
import venv
from collections.abc import Sequence
from pathlib import Path

from experiments.output.console import Console
from groundlink.core.errors import UserError
from groundlink.monitor.supervisor import end_with_parent

from .programs import DEBIAN_PACKAGES, DRIVERS, ExternalProgram

STAMP = "installed.txt"
"""File with the installed requirements of an environment."""


def python_of(program: ExternalProgram, out: Path, console: Console) -> Path:
    """Return the Python of a program's environment, created if missing.

    Raises
    ------
    UserError
        when a library of the system is missing, or pip cannot install the program.
    """
    check_libraries(program)
    folder = _folder(program, out)
    python = folder / "bin" / "python"
    if is_installed(program, out):
        return python
    console.print(f"{program.name}: making its environment with {', '.join(program.requirements)}")
    shutil.rmtree(folder, ignore_errors=True)
    venv.create(folder, with_pip=True)
    command = [str(python), "-m", "pip", "install", "--quiet", "--only-binary=:all:"]
    done = subprocess.run(
        [*command, *program.requirements], capture_output=True, text=True, check=False
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["pip said nothing"])[-1]
        raise UserError(
            f"{program.name}: pip cannot install {', '.join(program.requirements)}: {last}"
        )
    (folder / STAMP).write_text(_wanted(program), encoding="utf-8")
    return python


def is_installed(program: ExternalProgram, out: Path) -> bool:
    """Return whether a program's environment exists and is up to date."""
    stamp = _folder(program, out) / STAMP
    return stamp.exists() and stamp.read_text(encoding="utf-8") == _wanted(program)


def _folder(program: ExternalProgram, out: Path) -> Path:
    return out.resolve() / "environments" / program.name


def _wanted(program: ExternalProgram) -> str:
    return "\n".join(program.requirements) + "\n"


def check_libraries(program: ExternalProgram) -> None:
    """Refuse a program whose libraries the system lacks.

    Raises
    ------
    UserError
        with the packages to install.
    """
    if missing := [name for name in program.libraries if not _loads(name)]:
        packages = " ".join(DEBIAN_PACKAGES[name] for name in missing)
        raise UserError(
            f"{program.name} needs {', '.join(missing)}; on Debian: apt install {packages}"
        )


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def run(
    program: ExternalProgram,
    arguments: Sequence[str | Path],
    out: Path,
    console: Console,
    *,
    label: str,
    log: Path,
    script: str = "",
    limit_s: float = 900.0,
) -> str:
    """Run a program's driver and return its output.

    The last line of its log that begins with `progress ` is shown while it works.

    Parameters
    ----------
    script
        another script of `drivers`.

    Raises
    ------
    UserError
        when it fails, or takes longer than its limit.
    """
    python = python_of(program, out, console)
    words = [python, DRIVERS / (script or program.driver)]
    began_s = time.monotonic()
    with log.open("w", encoding="utf-8") as output:
        process = subprocess.Popen(
            [*map(str, words), *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            preexec_fn=end_with_parent,
        )
        try:
            while process.poll() is None:
                took_s = time.monotonic() - began_s
                if took_s > limit_s:
                    raise UserError(f"{label}: timeout after {limit_s:g} s; see {log}")
                console.progress(f"{label}: {program.name} {_progress(log)}, {took_s:.0f} s")
                time.sleep(0.1)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
    text = log.read_text(encoding="utf-8", errors="replace")
    if process.returncode:
        last = "\n".join(text.strip().splitlines()[-3:])
        raise UserError(
            f"{label}: {program.name} ended with {process.returncode}; {log} says:\n{last}"
        )
    return text


def _progress(log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    told = [line for line in lines if line.startswith("progress ")]
    return told[-1].removeprefix("progress ") if told else "starts"
