# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from groundlink.loader.scenario_files import SHIPPED
from services.sensors.imu.spec import GyroscopeNoise, InertialNoise, InertialUnit
from tests.services.sensors.sheets import from_sheet

SHEETS = sorted((SHIPPED / "sensors").glob("imu_*.yaml"))


@pytest.mark.parametrize("name", [sheet.stem for sheet in SHEETS])
def test_every_data_sheet_fits_and_names_its_device(name: str) -> None:
    assert from_sheet(InertialUnit, name).datasheet


def test_the_mti1_has_the_figures_of_its_table() -> None:
    mti1 = from_sheet(InertialUnit, "imu_mti1")
    assert mti1.accelerometer.noise_density == pytest.approx(120e-6 * 9.80665, rel=1e-4)
    assert mti1.gyroscope.noise_density == pytest.approx(math.radians(0.007), rel=1e-4)


def test_the_mpu_6000_has_the_figures_of_its_specification() -> None:
    mpu6000 = from_sheet(InertialUnit, "imu_mpu6000")
    assert mpu6000.accelerometer.noise_density == pytest.approx(400e-6 * 9.80665, rel=1e-4)
    assert mpu6000.accelerometer.resolution == pytest.approx(9.80665 / 2048, rel=1e-4)
    assert mpu6000.gyroscope.noise_density == pytest.approx(math.radians(0.005), rel=1e-4)
    assert mpu6000.gyroscope.resolution == pytest.approx(math.radians(1 / 16.4), rel=1e-4)
    assert mpu6000.gyroscope.g_sensitivity == pytest.approx(math.radians(0.1) / 9.80665, rel=1e-4)


def test_the_adis16448_wanders_as_in_its_source() -> None:
    """Sigma of a walk that is drawn back is its density times sqrt(time constant / 2)."""
    adis = from_sheet(InertialUnit, "imu_adis16448")
    for triad, density in ((adis.accelerometer, 6e-3), (adis.gyroscope, 3.8785e-5)):
        sigma = density * math.sqrt(triad.bias_time_constant_s / 2)
        assert triad.bias_instability == pytest.approx(0.61736 * sigma, rel=2e-3)


def test_the_ideal_one_has_no_errors() -> None:
    ideal = from_sheet(InertialUnit, "imu_ideal")
    assert ideal.accelerometer == InertialNoise()
    assert ideal.gyroscope == GyroscopeNoise()
    assert ideal.orientation_stddev_deg == 0
