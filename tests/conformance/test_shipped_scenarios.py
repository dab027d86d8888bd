# SPDX-License-Identifier: Apache-2.0
"""The kit finds nothing in a recording of a shipped scenario, but for what is listed."""

import subprocess
import sys
from pathlib import Path

import pytest

from groundlink.loader.scenario_files import SHIPPED
from sensor_conformance.checking import check_file

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(600)]

SECONDS = {"indoor_lab_tour": 14, "track": 10, "two_rovers": 10}
"""Duration of recordings in which turning has to be seen; others have 8 s."""

KNOWN = {"indoor_paper": {"image.alive"}}
"""Broken clauses: the paper's camera has no noise, and its robot stands at first."""


@pytest.mark.parametrize("name", sorted(file.stem for file in SHIPPED.glob("*.yaml")))
def test_all_clauses_hold(name: str, tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    subprocess.run(
        [
            *(sys.executable, "-m", "groundlink", "record", name, "--out", str(recording)),
            *("--duration", str(SECONDS.get(name, 8))),
        ],
        check=True,
        capture_output=True,
    )
    report = check_file(recording)
    assert {finding.clause.id for finding in report.findings} == KNOWN.get(name, set())
