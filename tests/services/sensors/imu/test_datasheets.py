# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest
import yaml

from groundlink.scenario.load import SHIPPED
from groundlink.scenario.sensors import Imu, InertialNoise

SHEETS = sorted((SHIPPED / "sensors").glob("imu_*.yaml"))


def read(name: str) -> Imu:
    sheet: dict[str, Any] = yaml.safe_load((SHIPPED / "sensors" / f"{name}.yaml").read_text())
    place = {"name": "imu", "topic": "/imu", "frame": "imu_link"}
    assert not place.keys() & sheet.keys()
    return msgspec.convert(sheet | place, Imu)


@pytest.mark.parametrize("name", [sheet.stem for sheet in SHEETS])
def test_every_data_sheet_fits_and_names_its_device(name: str) -> None:
    assert read(name).datasheet


def test_the_mti1_has_the_figures_of_its_table() -> None:
    mti1 = read("imu_mti1")
    assert mti1.accelerometer.noise_density == pytest.approx(120e-6 * 9.80665, rel=1e-4)
    assert mti1.gyroscope.noise_density == pytest.approx(math.radians(0.007), rel=1e-4)


def test_the_ideal_one_has_no_errors() -> None:
    ideal = read("imu_ideal")
    assert ideal.accelerometer == ideal.gyroscope == InertialNoise()
    assert ideal.orientation_stddev_deg == 0
