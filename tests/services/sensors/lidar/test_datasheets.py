# SPDX-License-Identifier: Apache-2.0
"""The shipped LiDAR data sheets say what the manual and the paper say."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
import yaml

from groundlink.scenario.load import SHIPPED
from groundlink.scenario.sensors import Lidar
from services.sensors.lidar.sweep import Sweep

# VLP-16 User Manual 63-9243 Rev D, table 9-1, by laser id, which is the order of firing.
ELEVATION_DEG = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]
OFFSET_MM = [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1]
OFFSET_MM += [-offset for offset in reversed(OFFSET_MM)]
LASER_US, CYCLE_US = 2.304, 55.296


def sheet(name: str) -> Lidar:
    document = yaml.safe_load((SHIPPED / "sensors" / f"{name}.yaml").read_text())
    return msgspec.convert(
        {**document, "name": "lidar", "topic": "/points", "frame": "lidar_link"}, Lidar
    )


@pytest.mark.parametrize("name", ["vlp16", "vlp16_paper"])
def test_lasers_fire_in_the_order_of_their_ids(name: str) -> None:
    spec = sheet(name)
    sweep = Sweep(spec)
    np.testing.assert_allclose(np.array(spec.elevations_deg)[sweep.rings], ELEVATION_DEG)
    np.testing.assert_allclose(sweep.seconds[:, 0], LASER_US * 1e-6 * np.arange(16))
    assert spec.elevations_deg == tuple(sorted(spec.elevations_deg))
    assert (spec.min_range_m, spec.max_range_m) == (0.5, 100.0)


def test_the_makers() -> None:
    spec = sheet("vlp16")
    np.testing.assert_allclose(1e3 * Sweep(spec).heights_m, OFFSET_MM, rtol=1e-6)
    cycle_us = 1e6 / (spec.rotation_rate_hz * spec.firings_per_revolution)
    assert cycle_us == pytest.approx(CYCLE_US, rel=3e-4)
    assert spec.firings_per_revolution == int(1e5 / CYCLE_US)
    assert spec.range_resolution_m == 0.002
    assert (spec.range_stddev_m, spec.laser_bias_m) == (0.01, 0.02)


def test_the_papers() -> None:
    spec = sheet("vlp16_paper")
    assert len(spec.elevations_deg) * spec.firings_per_revolution == 57_600
    assert 360 / spec.firings_per_revolution == 0.1
    assert set(np.diff(spec.elevations_deg)) == {2.0}
    assert (spec.range_stddev_m, spec.laser_bias_m) == (0.03, 0.0)
    assert (spec.vertical_offsets_m, spec.range_resolution_m) == ((), 0.0)
