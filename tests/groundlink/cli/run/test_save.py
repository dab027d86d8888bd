# SPDX-License-Identifier: Apache-2.0
"""Files that cannot be saved to or restored from, told before a run is looked for."""

from pathlib import Path

import pytest

from groundlink.__main__ import main

DAMAGED = b"groundlink journal 1 " + 64 * b"0" + b"\nnothing"


@pytest.mark.parametrize("command", ["restore", "up"])
def test_a_damaged_file_is_told_in_one_line(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.run"
    file.write_bytes(DAMAGED)
    assert main([command, str(file)]) == 2
    assert capsys.readouterr().err == (
        f"groundlink: {file}: truncated or damaged. Fix: copy or save the run again\n"
    )


def test_a_file_that_is_not_there_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["restore", str(tmp_path / "a.run")]) == 2
    assert "cannot read" in capsys.readouterr().err


def test_no_file_is_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.run"
    file.write_bytes(b"mine")
    assert main(["save", str(file)]) == 2
    assert capsys.readouterr().err == (
        f"groundlink: save {file}: file exists. Fix: delete it or choose another name\n"
    )
    assert file.read_bytes() == b"mine"
