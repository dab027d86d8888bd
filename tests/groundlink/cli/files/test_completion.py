# SPDX-License-Identifier: Apache-2.0
"""Completion by TAB: the script for bash in a real bash, with readline on a terminal."""

import os
import pty
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from groundlink.__main__ import main
from groundlink.cli.commands import parser
from groundlink.cli.files.completion import RUNS, SHELLS, WORDS, arguments, key_of

NO_WORDS = {
    "AZIMUTH,ELEVATION",
    "COMMAND",
    "DEG",
    "DIRECTION.FIELD=VALUE",
    "ENDPOINT",
    "F",
    "FIELD=VALUE",
    "FIELD=VALUE,...",
    "FIELD=VALUES",
    "FIGURE|COMMAND",
    "FRAME",
    "HOST",
    "KIND|{...}",
    "HOST:PORT",
    "LABEL",
    "M",
    "M/S",
    "N",
    "RAD/S",
    "NAME=VALUE",
    "S",
    "S,...",
    "SCENARIO[.yaml]",
    "SENSOR.FIELD=[A,...]",
    "START:LENGTH",
    "STEP",
    "TEXT",
    "TOPIC",
    "VEHICLE/SENSOR",
    "VEHICLE/SENSOR,...",
    "none|{...}",
    "VEHICLE=FILE",
    "WIDTHxHEIGHT",
    "X",
    "X,Y[,Z[,YAW]]",
    "camera",
    "heights_m",
    "host",
    "name",
    "port",
    "seed",
    "size_m",
    "ticks",
    "vehicle",
}
"""Arguments with values that only the user knows."""

READY = "ready>"
PRINTS_ITS_ARGUMENTS = "groundlink() { printf '<%s>' \"$@\"; echo; }"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with some files."""
    for name in ("first run.mcap", "first run.bag", "my_scenario.yaml"):
        (tmp_path / name).touch()
    (tmp_path / "runs_of_may").mkdir()
    return tmp_path


def write_script(shell: str, file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    file.write_text(capsys.readouterr().out, encoding="utf-8")


class Terminal:
    """A bash on a terminal."""

    def __init__(self, folder: Path) -> None:
        self._fd, child = pty.openpty()
        self._process = subprocess.Popen(
            ["bash", "--norc", "--noprofile", "-i"],
            stdin=child,
            stdout=child,
            stderr=child,
            cwd=folder,
            env={"PATH": os.environ["PATH"], "PS1": READY, "TERM": "dumb"},
            start_new_session=True,
        )
        os.close(child)
        self._read(READY)

    def typed(self, keys: str) -> str:
        """Type keys and Enter; return the last line that the command printed."""
        os.write(self._fd, keys.encode() + b"\n")
        return self._read(f"\n{READY}").rpartition("\n")[2]

    def _read(self, end: str) -> str:
        said, deadline = "", time.monotonic() + 20
        while not said.endswith(end):
            assert time.monotonic() < deadline, said
            if select.select([self._fd], [], [], 0.1)[0]:
                said += os.read(self._fd, 65536).decode().replace("\r", "")
        return said.removesuffix(end)

    def close(self) -> None:
        os.close(self._fd)
        self._process.wait(timeout=20)


def test_bash_completes_commands_options_names_and_files(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_script("bash", folder / "script", capsys)
    terminal = Terminal(folder)
    try:
        terminal.typed(PRINTS_ITS_ARGUMENTS)
        terminal.typed("source ./script")
        for keys, arguments_of_command in {
            "che\t ya\t --j\t": "<check><yard><--json>",
            "check my\t": "<check><my_scenario.yaml>",
            "report fi\t": "<report><first run.mcap>",
            "export --out ru\t fi\t": "<export><--out><runs_of_may/><first run.mcap>",
            "up --mo\t lock\t ya\t": "<up><--mode><lockstep><yard>",
            "sensors sh\t vlp16_p\t": "<sensors><show><vlp16_paper>",
            "fault rover/imu stu\t": "<fault><rover/imu><stuck>",
            "drive --route figu\t": "<drive><--route><figure_eight>",
            "explain lidar.dropo\t": "<explain><lidar.dropout>",
            "world sho\t vall\t": "<world><show><valley>",
        }.items():
            assert terminal.typed(f"groundlink {keys}") == arguments_of_command
    finally:
        terminal.close()


def test_bash_completes_the_runs_of_this_machine() -> None:
    physics = ("-m", "services.physics", "x.yaml", "--run", "lab_at_night")
    ps = f"ps() {{ echo 'python {' '.join(physics)} --listen tcp/127.0.0.1:7447'; }}"
    done = subprocess.run(["bash", "-c", f"{ps}; {RUNS}"], capture_output=True, text=True)
    assert done.stdout == "lab_at_night\n"


@pytest.mark.skipif(not shutil.which("fish"), reason="needs fish")
def test_fish_completes_commands_names_and_files(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_script("fish", folder / "script", capsys)
    for words, completed in {
        "che": "check",
        "check ya": "yard",
        "check my": "my_scenario.yaml",
        "report fi": "first run.mcap",
        "explain lidar.dropo": "lidar.dropout",
    }.items():
        command = f"source ./script; complete -C 'groundlink {words}'"
        done = subprocess.run(["fish", "-c", command], cwd=folder, capture_output=True, text=True)
        assert [line.partition("\t")[0] for line in done.stdout.splitlines()] == [completed]


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_is_valid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], shell: str
) -> None:
    if not shutil.which(shell):
        pytest.skip(f"needs {shell}")
    write_script(shell, tmp_path / "script", capsys)
    subprocess.run([shell, "-n", tmp_path / "script"], check=True)


def test_every_argument_is_completed_or_known_to_the_user_alone() -> None:
    keys = {key_of(action) for action in arguments(parser())}
    assert keys == WORDS.keys() | NO_WORDS
