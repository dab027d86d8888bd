# SPDX-License-Identifier: Apache-2.0
"""A mistake in the command line of a search or a campaign is one line, before the first run."""

import shlex
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink

from .conftest import Evaluations

SEARCH = "search indoor_lab_tour --vary lidar.dropout=0.0..0.5 --budget 16"
CAMPAIGN = "campaign indoor_lab_tour --check ./check"


@pytest.mark.parametrize(
    ("command", "words", "line"),
    [
        (SEARCH, "--vary lidar.dropout=0.0..2.0", "--vary lidar.dropout: given twice"),
        (SEARCH, "--vary imu.noise=1", "--vary imu.noise=1: one value"),
        (SEARCH, "--vary camera.exposure=1,2", "no `camera`"),
        (SEARCH, "--vary imu.rate_hz=-5..400", "rate_hz`: expected `float` > 0.0"),
        (SEARCH, "--budget 0", "--budget 0: expected 1 or more"),
        (SEARCH, "--maximize", "--maximize: needs --objective"),
        (SEARCH, "--jobs 0", "--jobs 0: expected 1 or more"),
        (CAMPAIGN, "--jobs 0", "--jobs 0: expected 1 or more"),
        (CAMPAIGN, "--duration 0", "--duration 0: expected seconds, more than 0"),
        (CAMPAIGN, "--fault stock", "--fault stock: no such kind"),
        (CAMPAIGN, "--phases 1,30", "--phases 30: expected 0 or more, and less than the 30 s"),
        (CAMPAIGN, "--for 0", "--for 0: expected seconds, more than 0"),
        (CAMPAIGN, "--sensors rover/gnss", "--sensors rover/gnss: no such sensor"),
        (CAMPAIGN, "--link '{to_ros: {loss: 2}}'", "expected `float` <= 1.0"),
        (CAMPAIGN, "--check ''", "campaign: needs --check"),
    ],
)
def test_mistake_is_one_line_before_the_first_run(
    command: str,
    words: str,
    line: str,
    evaluations: Evaluations,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    assert groundlink([*shlex.split(f"{command} {words}"), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert evaluations.requests == []
    assert not out.exists()
