# SPDX-License-Identifier: Apache-2.0
"""A fitted sheet is a data sheet, and its sensor has the recording's noise and dropout."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from groundlink.__main__ import main
from groundlink.core.errors import UserError
from groundlink.fitting.firings import Firings
from groundlink.fitting.lidar_sheet import echo_bands, fit, fitted_sheet
from groundlink.fitting.recordings import read_firings
from groundlink.fitting.sheet_file import sheet_text
from groundlink.loader.datasheets import CheckedDatasheet, load_datasheet
from services.sensors.lidar.spec import Lidar
from tests.services.sensors.scanning import targets

from . import rooms
from .test_recordings import cloud, mcap

BASE = CheckedDatasheet(
    Path("device.yaml"),
    "lidar",
    "A device: figures of its maker",
    {
        "elevations_deg": [-1.0, 1.0],
        "range_stddev_m": 0.03,
        "dropout": 0.5,
        "laser_bias_m": 0.02,
    },
)


def test_a_fitted_sheet_replaces_noise_and_keeps_the_rest(tmp_path: Path) -> None:
    found = fit(rooms.measured(0.005, 0.013, lost=0.1, step_m=0.004), "a room")
    path = tmp_path / "device_fitted.yaml"
    path.write_text(sheet_text(BASE, "a room", fitted_sheet(found, BASE.figures)))
    sheet = load_datasheet(str(path))
    assert sheet.title == "A device: figures of its maker; noise and dropout of a recording"
    assert sheet.figures.keys() == {
        "elevations_deg", "laser_bias_m", "range_resolution_m", "echo_bands"
    }  # fmt: skip
    assert sheet.figures["range_resolution_m"] == 0.004
    bands = sheet.figures["echo_bands"]
    assert bands["intensity"] == [rooms.DARK, rooms.WHITE]
    # Rounding is a noise of its own, a step over the root of twelve.
    assert np.mean(bands["stddev_m"][0]) == pytest.approx(0.013, rel=0.12)
    assert np.mean(bands["stddev_m"][1]) == pytest.approx(0.005, rel=0.2)
    assert np.mean(bands["dropout"][0]) == pytest.approx(0.1, abs=0.02)
    assert not np.any(bands["dropout"][1])
    text = path.read_text()
    for part in (
        "# Recording: a room",
        "# Noise over the table's, by incidence: ",
        " of 5 on smooth",
    ):
        assert part in text


def test_a_sensor_with_the_sheet_has_the_noise_of_the_recording() -> None:
    found = fit(rooms.measured(0.005, 0.013, lost=0.1), "a room")
    bands = echo_bands(found)
    lasers = {"elevations_deg": np.linspace(-2, 2, 9).tolist(), "echo_bands": bands}
    for material, stddev_m, lost in (("rubber", 0.013, 0.1), ("white", 0.005, 0.0)):
        seen = targets.returns(targets.wall(material, 8.0), **lasers)
        assert (seen.range_m - seen.true_range_m).std() == pytest.approx(stddev_m, rel=0.12)
        assert 1 - seen.returned.mean() == pytest.approx(lost, abs=0.02)


def test_the_command_fits_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, out = mcap(tmp_path / "room.mcap", cloud()), tmp_path / "new.yaml"
    arguments = ["fit", str(recording), "--sheet", "vlp16", "--out", str(out), "--source", "a room"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "Noise in millimeters" in printed
    assert f"wrote {out}\n" in printed
    place = {"name": "lidar", "topic": "/points", "frame": "lidar"}
    spec = msgspec.convert(load_datasheet(str(out)).figures | place, Lidar)
    assert (spec.firings_per_revolution, spec.range_stddev_m) == (1808, 0)
    assert spec.echo_bands is not None
    assert spec.echo_bands.stddev_m[-1][0] == pytest.approx(0.005, rel=0.2)
    assert "# Recording: a room" in out.read_text()
    assert main(arguments) != 0
    assert "file exists" in capsys.readouterr().err
    wrong = ["fit", str(recording), "--sheet", "hc_sr04", "--out", str(tmp_path / "x.yaml")]
    assert main(wrong) != 0
    assert "of kind `range`; expected one of gnss, imu, lidar, lidar_2d" in capsys.readouterr().err


def test_a_recording_without_smooth_surfaces_is_refused(tmp_path: Path) -> None:
    source = np.random.default_rng(1)
    shape = 500, 4
    rough = Firings(source.random(shape), source.random(shape), rooms.STEP_RAD)
    with pytest.raises(UserError, match=r"a field: .* windows of smooth surfaces, too few"):
        fit(rough, "a field")
    few = mcap(tmp_path / "few.mcap", cloud())
    firings = read_firings(few)
    with pytest.raises(UserError, match="too few"):
        fit(Firings(firings.range_m[:20], firings.intensity[:20], firings.step_rad), "a corner")
