# SPDX-License-Identifier: Apache-2.0
"""The Mid-360's pattern: beside the manufacturer's table, and over time."""

import numpy as np
import pytest

from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.mirror_sweep import MirrorSweep
from services.sensors.scanning.sweep import Sweep
from tests.services.sensors.lidar.native.test_vlp16 import sheet
from tests.services.sensors.sheets import from_sheet

from .moving_patterns import check_blocks_of_a_drive

# Mean zenith of the four lines by row, of the beginning of mid360.csv in
# Livox-SDK/livox_laser_simulation; a row every 5 us.
TABLE_DEG = {0: 42.10, 1872: 50.14, 2448: 54.26, 10660: 93.38, 11200: 91.63, 35188: 69.70}
FIRST_ROWS = [(268.99, 37.838), (269.0, 40.825), (269.0, 43.581), (269.0, 46.152)]


@pytest.fixture(scope="module")
def sweep() -> MirrorSweep:
    spec = from_sheet(Lidar, "mid360")
    assert spec.mirror is not None
    return MirrorSweep(spec, spec.mirror)


def angles_deg(sweep: Sweep) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuth and zenith of the present revolution, shape (lines, firings)."""
    x, y, z = sweep.directions_in_sensor.astype(np.float64)
    return np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arccos(z))


def test_elevations_are_near_the_table(sweep: MirrorSweep) -> None:
    sweep.aim(0)
    azimuth_deg, zenith_deg = angles_deg(sweep)
    first = [(azimuth_deg[line, 0], zenith_deg[line, 0]) for line in range(4)]
    # A line is 0.33 degrees of the mirror's turn after the one before.
    np.testing.assert_allclose(first, FIRST_ROWS, atol=1.05)
    for row, expected_deg in TABLE_DEG.items():
        sweep.aim(row // 20_000)
        zenith_deg = angles_deg(sweep)[1][:, row % 20_000 // 4].mean()
        assert zenith_deg == pytest.approx(expected_deg, abs=3.0)


def test_the_view_is_that_of_the_specification(sweep: MirrorSweep) -> None:
    lowest, highest = 90.0, -90.0
    for revolution in range(3):
        sweep.aim(revolution)
        azimuth_deg, zenith_deg = angles_deg(sweep)
        assert np.histogram(azimuth_deg, 36, (0, 360))[0].min() > 400
        lowest, highest = min(lowest, 90 - zenith_deg.max()), max(highest, 90 - zenith_deg.min())
        assert np.linalg.norm(sweep.directions_in_sensor, axis=0) == pytest.approx(1, abs=1e-6)
    assert (lowest, highest) == pytest.approx((-7, 52), abs=0.6)


def test_the_pattern_does_not_repeat_itself(sweep: MirrorSweep) -> None:
    """The share of cells of one degree that have been hit grows from message to message."""
    hit = np.zeros((60, 360), bool)
    shares = []
    for revolution in range(20):
        sweep.aim(revolution)
        azimuth_deg, zenith_deg = angles_deg(sweep)
        rows = np.floor(zenith_deg - 37.7).astype(int).clip(0, 59)
        hit[rows, np.floor(azimuth_deg).astype(int) % 360] = True
        shares.append(hit[1:58].mean())
    assert shares[0] < 0.7
    assert np.all(np.diff(shares[:6]) > 0.005)
    assert shares[-1] > 0.97


def test_points_of_blocks_and_messages_are_on_the_walls() -> None:
    fields = sheet("mid360", azimuth_stddev_deg=0.0, elevation_stddev_deg=0.0)
    fields |= {
        "range_stddev_m": 0.0,
        "range_resolution_m": 0.0,
        "min_range_m": 1.0,
    }  # Not its own wheels.
    check_blocks_of_a_drive(fields)
