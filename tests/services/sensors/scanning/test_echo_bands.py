# SPDX-License-Identifier: Apache-2.0
"""Noise and dropout by intensity and range are those of the table."""

from typing import Any

import msgspec
import numpy as np
import pytest

from groundlink.scenario.rotating_lidar import EchoBands
from services.sensors.lidar.spec import Lidar

from . import targets
from .test_noise import chi_square_holds

LASERS: dict[str, Any] = {"elevations_deg": [-2.0, -1.0, 0.0, 1.0, 2.0]}
BANDS: dict[str, Any] = {
    "intensity": [10, 50],
    "range_m": [10, 30],
    "stddev_m": [[0.02, 0.04], [0.01, 0.01]],
    "dropout": [[0.1, 0.3], [0.0, 0.0]],
}


def seen(material: str, distance_m: float, **spec: Any) -> Any:
    return targets.returns(targets.wall(material, distance_m), **LASERS, **spec)


@pytest.mark.parametrize(
    ("material", "distance_m", "stddev_m", "dropout"),
    [
        ("dark", 10.0, 0.02, 0.1),
        ("dark", 20.0, 0.03, 0.2),
        ("dark", 60.0, 0.04, 0.3),
        ("gray", 20.0, 0.01, 0.0),
        ("white", 5.0, 0.01, 0.0),
        ("rubber", 5.0, 0.02, 0.1),
    ],
)
def test_the_table_is_interpolated_and_its_ends_go_on(
    material: str, distance_m: float, stddev_m: float, dropout: float
) -> None:
    got = seen(material, distance_m, echo_bands=BANDS)
    chi_square_holds((got.range_m - got.true_range_m)[0].astype(np.float64) / stddev_m)
    lost = 1 - got.returned.mean()
    assert lost == pytest.approx(dropout, abs=5 * np.sqrt(0.25 / got.returned.size))
    assert (lost == 0) == (dropout == 0)


def test_between_intensities_noise_is_interpolated_too() -> None:
    """A gray wall at an angle of incidence of 53 degrees has 30 %, half way from 10 to 50."""
    made = targets.scenario(
        targets.wall("gray", 6.0), start_deg=53.13, field_of_view_deg=0.2, echo_bands=BANDS,
        firings_per_revolution=36000, elevations_deg=np.linspace(-0.2, 0.2, 60).tolist(),
    )  # fmt: skip
    got = targets.measured(made)
    assert set(np.unique(got.intensity)) == {30.0}
    error = (got.range_m - got.true_range_m)[0]
    assert error.std() == pytest.approx(0.015, rel=0.1)


def test_other_noise_and_loss_add_independently() -> None:
    noise = {"range_stddev_m": 0.03, "range_stddev_share": 0.001, "dropout": 0.2}
    got = seen("dark", 10.0, echo_bands=BANDS, **noise)
    sigma = np.sqrt(0.02**2 + 0.03**2 + (0.001 * got.true_range_m) ** 2)
    chi_square_holds(((got.range_m - got.true_range_m) / sigma)[0].astype(np.float64))
    assert 1 - got.returned.mean() == pytest.approx(1 - 0.8 * 0.9, abs=0.03)


def test_weather_makes_noise_larger() -> None:
    """In fog the same wall is darker, so its noise is that of a darker one."""
    fog = {"weather": targets.Weather(fog_visibility_m=60.0), "full_range_reflectivity": 0.001}
    wall = targets.wall("gray", 10.0)
    made = targets.scenario(wall, echo_bands=BANDS, returns="last", **LASERS, **fog)
    got = targets.measured(made)
    clear = seen("gray", 10.0, echo_bands=BANDS)
    of_wall = got.label[0] >= 0
    assert of_wall.mean() > 0.9
    error = (got.range_m - got.true_range_m)[0]
    darker = got.intensity[0, of_wall].mean()
    assert darker < 25
    expected = np.interp(darker, [10, 50], [0.02, 0.01])
    assert error[of_wall].std() == pytest.approx(expected, rel=0.05)
    assert (clear.range_m - clear.true_range_m).std() == pytest.approx(0.01, rel=0.05)


def test_a_table_of_one_row_or_column_is_constant_along_it() -> None:
    one = {"intensity": [20], "range_m": [5, 25], "stddev_m": [[0.01, 0.03]]}
    got = seen("white", 15.0, echo_bands=one)
    chi_square_holds((got.range_m - got.true_range_m)[0].astype(np.float64) / 0.02)
    single = {"intensity": [20], "range_m": [5], "dropout": [[1.0]]}
    assert not seen("white", 15.0, echo_bands=single).returned.any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"intensity": [50, 10]}, "`intensity` is .* expected ascending"),
        ({"range_m": []}, "`range_m` is .* expected ascending"),
        ({"stddev_m": [[0.1, 0.2]]}, "`stddev_m` has rows of .* expected a row for each of 2"),
        ({"dropout": [[0.1], [0.2]]}, "`dropout` has rows of .* each with 2 ranges"),
        ({"dropout": [[0.1, 2], [0.2, 0]]}, "Expected `float` <= 1.0"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.convert(BANDS | change, EchoBands)


def test_a_sheet_without_a_table_has_none() -> None:
    spec = msgspec.convert(
        {"name": "l", "topic": "/l", "frame": "l", "elevations_deg": [0.0]}, Lidar
    )
    assert (spec.echo_bands, spec.mixed_pixels, spec.blooming) == (None, False, None)
