# SPDX-License-Identifier: Apache-2.0
"""Fitted sheets have their recordings' Allan deviation, and model recordings are the model's."""

import re

import numpy as np
import pytest

from groundlink.loader.datasheets import load_datasheet
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import InertialUnit
from tests.services.sensors.imu.test_model import forces, rates, samples
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.states import scenario, states
from tools.at_rest import imu_at_rest
from tools.fitted_at_rest import DEVICES, PAGE, PICTURE
from tools.recordings_at_rest import COLUMNS, RECORDINGS, standstill


@pytest.mark.parametrize("rate_hz", [400.0, 100.0, 248.6])
@pytest.mark.parametrize("sheet", ["imu_mpu6000", "imu_adis16448"])
def test_readings_at_rest_are_those_of_the_model(sheet: str, rate_hz: float) -> None:
    spec = from_sheet(InertialUnit, sheet, rate_hz=rate_hz, name="imu")
    run = scenario()
    taken = samples(ImuModel(run, run.vehicles[0], spec), states(np.zeros((801, 3))))
    expected = np.hstack([forces(taken), rates(taken)])
    (found,) = imu_at_rest(spec, 2).segments
    assert len(found) >= 1.8 * rate_hz
    last = int(np.argmin(np.abs(expected - found[-1]).sum(axis=1)))
    assert last >= len(expected) - 2
    np.testing.assert_allclose(found, expected[last + 1 - len(found) : last + 1], atol=1e-9)


def test_every_band_of_the_page_is_within_a_fifth() -> None:
    """But for those with vibration, which are less than a tenth."""
    text = PAGE.read_text()
    sheets = re.findall(r"`datasheet: (\w+)`", text)
    assert sheets == [f"{name}_fitted" for name in DEVICES]
    assert sum(sheet.startswith("imu_") for sheet in sheets) >= 4
    for sheet in sheets:
        assert load_datasheet(sheet).title.endswith("of a recording")
    found = re.findall(r"^\| [\d.]+ s \|.* ([+-]\d+)% \| ?(\w*) *\|$", text, re.MULTILINE)
    assert len(found) == len(re.findall(r"^\| [\d.]+ s ", text, re.MULTILINE)) > 80
    noise = [int(percent) for percent, mark in found if not mark]
    assert max(map(abs, noise)) <= 20
    assert len(noise) > 0.9 * len(found)
    assert PICTURE.exists()


def test_only_standstill_is_kept() -> None:
    source = np.random.default_rng(1)
    rates = 0.01 * source.normal(size=(3000, 3))
    rates[700:900] += source.normal(size=(200, 3))
    kept = standstill(rates, 100, 2)
    assert not kept[675:925].any()
    assert kept[25:675].all()
    assert kept[950:2975].all()
    # A rest of a second is too short.
    rates[1000:1200] += source.normal(size=(200, 3))
    assert not standstill(rates, 100, 2)[900:1000].any()


def test_tables_of_recordings_have_the_columns_of_the_command() -> None:
    assert {f"{name}.csv" for name in RECORDINGS} <= {one.file for one in DEVICES.values()}
    assert COLUMNS[:2] == ["t", "linear_acceleration.x"]
