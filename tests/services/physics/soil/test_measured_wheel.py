# SPDX-License-Identifier: Apache-2.0
"""Rigid wheels in soil agree with a measured wheel, from skid to spin."""

import numpy as np
import pytest

from services.physics.soil.wheel import wheel_forces, wheel_sinkage
from tools.plots.measured_wheel import MEASURED, RADIUS_M, SAND, WIDTH_M, WheelMeasurement


@pytest.mark.parametrize("row", MEASURED, ids=lambda row: f"slip {row.slip}")
def test_a_measured_wheel_in_sand(row: WheelMeasurement) -> None:
    """The drawbar pull deviates by no more than readings scatter, the sinkage by 12 %."""
    slip = np.array(row.slip)
    sinkage = wheel_sinkage(SAND, RADIUS_M, WIDTH_M, np.array(row.load_n), slip)
    drawbar = wheel_forces(SAND, RADIUS_M, WIDTH_M, sinkage, slip).drawbar_n
    assert drawbar == pytest.approx(row.drawbar_n, abs=row.scatter_n)
    assert sinkage == pytest.approx(row.sinkage_m, rel=0.12)
