# SPDX-License-Identifier: Apache-2.0
"""Fitted sheets have their recordings' noise, by the page and by a recording of known answers."""

import re

import msgspec
import numpy as np
import pytest

from groundlink.fitting import echo_statistics as statistics
from groundlink.fitting.lidar_sheet import echo_bands, fit
from groundlink.loader.datasheets import load_datasheet
from services.sensors.lidar.spec import Lidar
from tests.groundlink.fitting import rooms
from tools.fitted_lidars import DEVICES, PAGE, FitComparison, measured, rows


def test_every_band_of_the_page_is_within_a_fifth() -> None:
    text = PAGE.read_text()
    sheets = re.findall(r"`datasheet: (\w+)`", text)
    assert sheets == [f"{name}_fitted" for name in DEVICES]
    assert len(sheets) >= 6
    for sheet in sheets:
        assert load_datasheet(sheet).figures["echo_bands"]["stddev_m"]
    differences = [int(found) for found in re.findall(r"mm \| ([+-]\d+)% \|", text)]
    assert len(differences) == len(re.findall(r"^\| \d", text, re.MULTILINE)) > 90
    assert max(map(abs, differences)) <= 20


def test_the_receiver_of_a_fitted_sheet_has_the_recordings_figures() -> None:
    recorded = fit(rooms.measured(0.006, 0.015, lost=0.05, step_m=0.002), "a room")
    document = {"name": "lidar", "topic": "/points", "frame": "lidar", "elevations_deg": [0.0]}
    document |= {"echo_bands": echo_bands(recorded), "range_resolution_m": 0.002}
    again, lost = measured(msgspec.convert(document, Lidar), recorded.windows)
    noise = statistics.noise_bands(statistics.find_windows(again))
    compared = FitComparison(recorded, noise, statistics.dropout_bands(lost))
    np.testing.assert_allclose(noise.value, recorded.noise.value, rtol=0.1)
    dark = compared.dropout.value[0]
    assert dark[np.isfinite(dark)] == pytest.approx(0.05, abs=0.015)
    for row in rows(compared):
        assert abs(int(re.findall(r"([+-]\d+)%", row)[0])) <= 10
