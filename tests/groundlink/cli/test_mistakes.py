# SPDX-License-Identifier: Apache-2.0
"""Mistakes at the command line that need no run: one line on stderr, and the exit code."""

from __future__ import annotations

from pathlib import Path

import pytest

from groundlink.__main__ import main
from groundlink.scenario.load import SHIPPED


def line(capsys: pytest.CaptureFixture[str], *words: str, code: int = 2) -> str:
    """Return the one line with which a command ends."""
    assert main(words) == code
    out, error = capsys.readouterr()
    assert out == ""
    assert error.count("\n") == 1, error
    return error


def on_gpu(folder: Path) -> Path:
    """Write a scenario whose camera is on another host."""
    text = (SHIPPED / "indoor_lab.yaml").read_text(encoding="utf-8")
    file = folder / "spread.yaml"
    file.write_text(text.replace("name: camera,", "name: camera, host: gpu,"), encoding="utf-8")
    return file


@pytest.mark.parametrize("command", [["compose"], ["secure", "--name", "sim.example"]])
def test_another_host_needs_the_router_of_the_main_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    words = [*command, str(on_gpu(tmp_path)), *(["out"] if command[0] == "secure" else [])]
    assert "--host gpu: expected --router ENDPOINT" in line(capsys, *words, "--host", "gpu")
