# SPDX-License-Identifier: Apache-2.0
"""The file that a process touches as long as it is well."""

from pathlib import Path

import pytest

from groundlink.process.joining import VARIABLE, LivenessFile


def test_it_is_touched_while_there_is_a_link_and_no_longer(tmp_path: Path) -> None:
    file, links = tmp_path / "alive", [True, True, False, False]
    liveness = LivenessFile("rover/imu", lambda: links.pop(0), {VARIABLE: str(file)})
    liveness.update(0.0)
    file.unlink()
    liveness.update(1.0)
    assert file.exists()
    file.unlink()
    liveness.update(2.0)
    liveness.update(3.0)
    assert not file.exists()


def test_changes_are_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    links = [True, False, False, True, True]
    liveness = LivenessFile("rover/imu", lambda: links.pop(0), {})
    for second in range(5):
        liveness.update(float(second))
    assert capsys.readouterr().err.splitlines() == [
        "rover/imu: connection to the router lost; reconnecting",
        "rover/imu: reconnected to the router after 2.0 s",
    ]
