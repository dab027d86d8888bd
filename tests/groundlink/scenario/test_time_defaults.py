# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import msgspec

from groundlink.scenario.schema import Time


def test_a_scenario_that_says_nothing_of_time_runs_so() -> None:
    """Scenarios, documents and other programs count on these."""
    assert msgspec.to_builtins(Time()) == {
        "mode": "realtime",
        "lockstep": "sensors",
        "factor": 1.0,
        "overload": "slow",
        "deadline_s": 5.0,
        "catch_up": 0.05,
        "epoch": None,
        "clock_rate_hz": 100.0,
        "window_ticks": 400,
        "answers": {"/cmd_vel": "/clock"},
    }
