# SPDX-License-Identifier: Apache-2.0
"""Rates of sensors whose scenario gives none: users and docs rely on them."""

from __future__ import annotations

import pytest
from msgspec import json

from groundlink.scenario.sensors import Sensor, sensor_rate_hz

RATES_HZ = {
    "camera": 30.0,
    "depth_camera": 30.0,
    "stereo_camera": 30.0,
    "encoders": 50.0,
    "gnss": 5.0,
    "imu": 400.0,
    "lidar": 10.0,
    "lidar_2d": 10.0,
    "range": 20.0,
    "wheel_odometry": 50.0,
}
NEEDED = {
    "lidar": {"elevations_deg": [0.0]},
    "range": {"radiation": "infrared", "field_of_view_deg": 10, "max_range_m": 5},
    "wheel_odometry": {"encoders": "encoders"},
    "stereo_camera": {"topic": "/l/it", "right_topic": "/r/it", "baseline_m": 0.1},
}


@pytest.mark.parametrize(("kind", "rate_hz"), RATES_HZ.items())
def test_a_rate_that_is_not_given(kind: str, rate_hz: float) -> None:
    fields = {"kind": kind, "name": "it", "topic": "/it", "frame": "it"} | NEEDED.get(kind, {})
    spec: Sensor = json.decode(json.encode(fields), type=Sensor)  # type: ignore[arg-type]
    assert sensor_rate_hz(spec) == rate_hz
