# SPDX-License-Identifier: Apache-2.0
"""The file that a process touches as long as it is well."""

from __future__ import annotations

from pathlib import Path

import pytest

from groundlink.process.liveness_file import VARIABLE, LivenessFile


def test_it_is_touched_while_there_is_a_link_and_no_longer(tmp_path: Path) -> None:
    file, links = tmp_path / "alive", [True, True, False, False]
    alive = LivenessFile("rover/imu", lambda: links.pop(0), {VARIABLE: str(file)})
    alive.show(0.0)
    file.unlink()
    alive.show(1.0)
    assert file.exists()
    file.unlink()
    alive.show(2.0)
    alive.show(3.0)
    assert not file.exists()


def test_what_changes_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    links = [True, False, False, True, True]
    alive = LivenessFile("rover/imu", lambda: links.pop(0), {})
    for second in range(5):
        alive.show(float(second))
    assert capsys.readouterr().err.splitlines() == [
        "rover/imu: no link to the router; looking for it",
        "rover/imu: the router is back after 2.0 s",
    ]
