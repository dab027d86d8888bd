# SPDX-License-Identifier: Apache-2.0
"""What light is noticed, and what intensity is told of it."""

from typing import Any

import numpy as np
import pytest

from services.sensors.scanning.returns import Returns

from . import targets

AXIS: dict[str, Any] = {"field_of_view_deg": 0.001, "start_deg": 0.0}


def straight_at(material: str, distance_m: float, **spec: Any) -> Returns:
    return targets.returns(targets.wall(material, distance_m), **{**AXIS, **spec})


def intensity(material: str, distance_m: float, **spec: Any) -> float:
    seen = straight_at(material, distance_m, **spec)
    assert seen.returned.all()
    return float(seen.intensity[0, 0, 0])


@pytest.mark.parametrize("distance_m", [1.0, 7.0, 42.0, 99.0])
def test_calibrated_intensity_does_not_depend_on_distance(distance_m: float) -> None:
    assert [intensity(m, distance_m) for m in ("white", "gray", "dark")] == [100, 50, 10]


def test_received_intensity_goes_with_distance_squared() -> None:
    raw = {"intensity": "received"}
    assert [intensity("white", d, **raw) for d in (10.0, 20.0, 5.0)] == pytest.approx(
        [100, 25, 400]
    )
    assert intensity("dark", 10.0, **raw) == pytest.approx(10)


def test_intensity_goes_with_the_cosine_of_incidence() -> None:
    made = targets.scenario(targets.wall("gray", 10.0), start_deg=60.0)
    seen, azimuth = targets.measured(made), targets.azimuths(made)
    np.testing.assert_allclose(seen.intensity[0], 50 * np.cos(azimuth), atol=0.5 + 1e-4)


def test_retroreflectors_are_above_a_hundred_up_to_255() -> None:
    ideal, worn = intensity("sign", 30.0), intensity("worn_sign", 30.0)
    assert ideal == 255
    assert worn == round(101 + 154 * 0.3)
    made = targets.scenario(targets.wall("worn_sign", 10.0), start_deg=80.0, max_range_m=1000.0)
    slanted = targets.measured(made).intensity
    assert 101 <= slanted.min() < slanted.max() < worn


@pytest.mark.parametrize("wide", [{}, {"divergence_mrad": [0.1, 0.1], "rays_per_beam": 4}])
@pytest.mark.parametrize(
    ("material", "reach_m"),
    [("white", 100.0), ("gray", 100 * np.sqrt(0.5 / 0.8)), ("dark", 100 * np.sqrt(0.1 / 0.8))],
)
def test_what_is_too_dark_for_its_distance_is_not_noticed(
    material: str, reach_m: float, wide: dict[str, Any]
) -> None:
    sheet = {"full_range_reflectivity": 0.8, "max_range_m": 100.0, **wide}
    assert straight_at(material, reach_m - 0.1, **sheet).returned.all()
    beyond = straight_at(material, reach_m + 0.1, **sheet)
    assert not beyond.returned.any()
    assert (beyond.label.item(), beyond.body.item()) == (-1, -1)
    assert np.isinf(beyond.true_range_m).all()


def test_slanted_surfaces_are_noticed_less_far() -> None:
    """rho cos(i) / R^2 on a wall along the way, d away: cos(i) = d / R, so R^3 = d rho / P."""
    side = targets.box("gray", (0, 5.5, 0), (900, 1, 900), "side")
    sheet = {"full_range_reflectivity": 0.5, "max_range_m": 100.0}
    made = targets.scenario(side, start_deg=12.0, **sheet)
    seen = targets.measured(made)
    reach = (5.0 * 100**2) ** (1 / 3)
    plain = targets.measured(targets.scenario(side, start_deg=12.0)).true_range_m
    np.testing.assert_array_equal(seen.returned, plain <= reach)
    assert 0.2 < seen.returned.mean() < 0.8


def test_a_threshold_of_zero_sees_everything() -> None:
    assert straight_at("rubber", 99.0).returned.all()
