# SPDX-License-Identifier: Apache-2.0
"""What `groundlink snapshot` refuses before anything is started."""

from pathlib import Path

import pytest

from groundlink.__main__ import main


def test_pictures_go_into_a_folder_and_not_into_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["snapshot", "indoor_lab", "rover/camera", "--out", "shot.jpg"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--out shot.jpg: expected a folder" in line
    assert list(tmp_path.iterdir()) == []
