# SPDX-License-Identifier: Apache-2.0
"""Recordings of Groundlink's own receiver at rest fit back to the figures of its data sheet."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.__main__ import main
from groundlink.core.errors import UserError
from groundlink.fitting.positions import Positions
from groundlink.fitting.receiver_sheet import fit, fitted_sheet
from groundlink.loader.datasheets import load_datasheet
from services.sensors.gnss.spec import Gnss
from tests.services.sensors.sheets import from_sheet
from tools.at_rest import receiver_at_rest

from .test_positions import fixes


@pytest.mark.parametrize(
    "sheet", ["gnss_single_point", "gnss_sbas", "gnss_rtk_float", "gnss_rtk_fix"]
)
def test_hours_fit_back_to_the_sheet(sheet: str) -> None:
    spec = from_sheet(Gnss, sheet, rate_hz=1)
    base = load_datasheet(sheet)
    wrong = base.figures | {"horizontal": {}, "vertical": {}, "drift_time_s": 300}
    positions = Positions(receiver_at_rest(spec, 7200), spec.solution, 0)
    found = fit(positions, base._replace(figures=wrong))
    time_s = found.time_s()
    assert time_s is not None
    errors = found.curves["horizontal"].errors
    assert abs(np.log(time_s / spec.drift_time_s)) < 3 * errors["time_s"] < 1
    for name, fields in found.fields().items():
        curve, noise = found.curves[name], getattr(spec, name)
        for of, field in (("white", "white_stddev_m"), ("drift", "drift_stddev_m")):
            apart = abs(np.log(fields[field] / getattr(noise, field)))
            assert apart < 3 * curve.errors[of] < 1, (name, field)
        assert np.abs(curve.differences).max() < 0.2


def test_a_few_minutes_keep_the_time_of_the_base() -> None:
    spec = from_sheet(Gnss, "gnss_sbas")
    positions = Positions(receiver_at_rest(spec, 300), "sbas", 7)
    sheet = fitted_sheet(positions, load_datasheet("gnss_sbas"))
    assert sheet.figures["horizontal"]["white_stddev_m"] == pytest.approx(0.25, rel=0.1)
    assert sheet.figures["drift_time_s"] == 60
    assert sheet.comments[0] == (
        "Length: 300 s at rest, 1500 fixes at 5 Hz of type sbas, 1 segment(s); 7 of other types "
        "left out."
    )
    # Its drift is that of the base, as far as five minutes show.
    assert sheet.comments[-1].endswith("does not show them: drift_stddev_m, drift_time_s.")


def test_of_several_types_of_solution_that_of_the_recording_is_fitted() -> None:
    base = load_datasheet("gnss_zed_f9p")
    series = receiver_at_rest(from_sheet(Gnss, "gnss_rtk_fix"), 600)
    figures = fitted_sheet(Positions(series, "rtk_fix", 0), base).figures
    before, after = base.figures["solutions"], figures["solutions"]
    assert [one["type"] for one in after] == [one["type"] for one in before]
    assert after[:3] == before[:3]
    assert after[3]["horizontal"]["white_stddev_m"] == pytest.approx(0.006, rel=0.1)
    assert after[3]["after_s"] == 10
    two = base._replace(figures=base.figures | {"solutions": before[:2]})
    with pytest.raises(UserError, match=r"solutions: none of type rtk_fix, .* single_point, sbas"):
        fitted_sheet(Positions(series, "rtk_fix", 0), two)


def test_the_command_fits_a_receiver(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, out = fixes(tmp_path / "run.mcap"), tmp_path / "mine.yaml"
    arguments = ["fit", str(recording), "--sheet", "gnss_single_point", "--out", str(out)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "Allan deviation of the horizontal position, m, by averaging time:" in printed
    sensor: Any = load_datasheet(str(out)).sensor()
    # The recording is of fixes with SBAS.
    assert sensor.solution == "sbas"
    assert sensor.horizontal.drift_stddev_m > 2
    assert "# Recording: run.mcap" in out.read_text()
