# SPDX-License-Identifier: Apache-2.0
"""A shell command gets its arguments, tells its last line, and leaves no process."""

import time
from pathlib import Path

import pytest

from groundlink.cli.run.cases import run_in_shell


@pytest.mark.parametrize(
    ("command", "arguments", "result"),
    [
        ("echo first; echo", ("a file.mcap",), ("a file.mcap", 0)),
        ("pwd; basename $PWD", (), ("folder", 0)),
        ("exit 3;", ("unused",), ("-", 3)),
    ],
)
def test_last_line_and_exit_code(
    command: str, arguments: tuple[str, ...], result: tuple[str, int], tmp_path: Path
) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    assert run_in_shell(command, *arguments, folder=folder) == result


def test_no_process_is_left() -> None:
    pid, code = run_in_shell("sleep 300 >/dev/null 2>&1 & echo $!; :")
    assert code == 0
    state = Path(f"/proc/{pid}/stat")
    while state.exists() and state.read_text(encoding="utf-8").split()[2] != "Z":
        time.sleep(0.01)
