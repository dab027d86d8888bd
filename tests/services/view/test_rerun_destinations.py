# SPDX-License-Identifier: Apache-2.0
"""Where recordings go."""

from pathlib import Path

import pytest
import rerun.blueprint as rrb

from groundlink.core.errors import UserError
from services.view.rerun_destinations import RerunFile, program


def test_a_file_in_no_folder_is_the_users_to_mend(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"--save .*: no such folder"):
        RerunFile(tmp_path / "none" / "run.rrd", rrb.Blueprint())


def test_each_episode_has_a_file(tmp_path: Path) -> None:
    destination = RerunFile(tmp_path / "run.rrd", rrb.Blueprint())
    for _ in range(2):
        destination.new_recording()
    destination.close()
    assert {file.name for file in tmp_path.iterdir()} == {"run.rrd", "run-2.rrd"}
    assert all(file.stat().st_size for file in tmp_path.iterdir())


def test_the_program_is_the_binary_itself() -> None:
    assert program().read_bytes()[:4] == b"\x7fELF"
