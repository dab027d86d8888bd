# SPDX-License-Identifier: Apache-2.0
import math

import pytest
from msgspec.structs import replace

from groundlink.scenario.every_sensor import Mount
from services.sensors.range.model import RangeModel
from services.sensors.range.spec import RangeFinder
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.yards import box, resting, yard

RADIATION = {
    "hc_sr04": "ultrasound",
    "srf08": "ultrasound",
    "gp2y0a21yk": "infrared",
    "vl53l1x": "infrared",
}


@pytest.mark.parametrize(("name", "radiation"), RADIATION.items())
def test_every_sheet_fits_and_measures_a_wall(name: str, radiation: str) -> None:
    spec = replace(from_sheet(RangeFinder, name), mount=Mount((1.0, 0.0, 0.5)))
    assert spec.datasheet
    assert spec.radiation == radiation
    distance_m = 0.7
    made = yard(box("wall", (1, 40, 40), (1.5 + distance_m, 0, 0.5)))
    (reading,) = RangeModel(made, made.vehicles[0], spec).readings(resting(1)[0])
    # Over its cone, the mean to a wall is a little more than the nearest.
    sigma = math.sqrt(reading.variance_m2) + spec.turn_on_bias_m + spec.range_resolution_m
    assert abs(reading.range_m - distance_m) < 4 * sigma + 0.02 * distance_m


def test_the_vl53l1x_sees_gray_about_as_far_as_its_sheet_says() -> None:
    spec = from_sheet(RangeFinder, "vl53l1x")
    assert spec.max_range_m * math.sqrt(0.17 / spec.full_range_reflectivity) == pytest.approx(
        1.7, rel=0.1
    )
