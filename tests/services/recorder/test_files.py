# SPDX-License-Identifier: Apache-2.0
"""A file for each life of physics, and never one over another."""

from __future__ import annotations

from pathlib import Path

import pytest

from groundlink.recording.reading import Recording
from groundlink.scenario import load
from groundlink.scenario.load import SHIPPED
from services.recorder.__main__ import Files


def test_what_exists_stays_and_the_next_goes_beside_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = Files(tmp_path / "run.mcap", load(str(SHIPPED / "indoor_lab.yaml")), "lab")
    for epoch, name in enumerate(("run.mcap", "run_2.mcap", "run_3.mcap")):
        file = files.begin(epoch)
        file.mcap.commit("groundlink.topics", {})
        file.mcap.close()
        assert files.path == tmp_path / name
        with Recording(files.path) as recording:
            assert recording.run.epoch_nanos == epoch
            assert recording.run.run == "lab"
    said = capsys.readouterr().out.splitlines()
    assert [line.rpartition("/")[2] for line in said] == ["run_2.mcap", "run_3.mcap"]
