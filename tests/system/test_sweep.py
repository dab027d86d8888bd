# SPDX-License-Identifier: Apache-2.0
"""A sweep over a scenario of one's own: more slip gives wheel odometry more error."""

import csv
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink
from groundlink.report.analysis.key_figures import key_figures_of

pytestmark = pytest.mark.system

SCENARIO = """
name: swept
world: worlds/lab.yaml
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    route: {kind: circle, laps: 3}
    sensors:
      - {kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link, rate_hz: 50.0,
         ticks_per_revolution: 80914}
      - {kind: wheel_odometry, name: odometry, encoders: encoders, topic: /odom, frame: odom}
"""


def test_more_slip_gives_more_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "swept.yaml"
    scenario.write_text(SCENARIO)
    out = tmp_path / "out"
    values = "encoders.slip_stddev=0,0.5"
    words = ["sweep", str(scenario), "--set", values, "--duration", "3", "--out", str(out)]
    assert groundlink(words) == 0
    assert "encoders.slip_stddev=0.5 (sensors only, on the drive of 1)" in capsys.readouterr().out
    with (out / "table.csv").open(newline="") as opened:
        exact, slipping = csv.DictReader(opened)
    assert float(exact["driven m"]) == float(slipping["driven m"]) > 0.5
    errors = [float(row["/odom error RMS m"]) for row in (exact, slipping)]
    assert errors[1] > 2 * errors[0]
    whole = tmp_path / "whole.mcap"
    words = ["record", str(scenario), "--set", "encoders.slip_stddev=0.5", "--duration", "3"]
    assert groundlink([*words, "--out", str(whole)]) == 0
    assert key_figures_of(whole) == key_figures_of(out / "2.mcap")
