# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import stats

from groundlink.core.frames import quaternion_from_rpy
from groundlink.messages.base import State
from groundlink.messages.imagery import Range
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from services.sensors.range.model import RangeModel, cone
from services.sensors.range.spec import RangeFinder
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, moving, resting, yard

AHEAD = Mount((1.0, 0.0, 0.5))
"""Beyond the wheels, 0.5 m above the base."""


def wall(distance_m: float, yaw_deg: float = 0.0, material: str = "gray") -> Any:
    """Return a wall whose face is at this distance from the sensor, turned about that point."""
    yaw = math.radians(yaw_deg)
    half = 0.5  # of its thickness
    solid = box(
        *("wall", (2 * half, 40, 40)),
        (1 + distance_m + half * math.cos(yaw), half * math.sin(yaw), 0.5),
        material,
    )
    return replace(solid, orientation=quaternion_from_rpy(0, 0, yaw))


def finder(made: Scenario, **fields: Any) -> RangeModel:
    fields = {
        "field_of_view_deg": 15.0,
        "max_range_m": 4.0,
        "radiation": "ultrasound",
        "mount": AHEAD,
        **fields,
    }
    spec = RangeFinder(name="sonar", topic="/sonar", frame="sonar_link", **fields)
    return RangeModel(made, made.vehicles[0], spec)


def readings(model: RangeModel, run: Iterable[State]) -> list[Range]:
    taken = []
    for state in run:
        taken += model.readings(state)
        assert model.settled_tick() == state.tick
    return taken


def measured(made: Scenario, **fields: Any) -> float:
    (reading,) = readings(finder(made, **fields), resting(1))
    return reading.range_m


@pytest.mark.parametrize("field_of_view_deg", [2.0, 15.0, 55.0, 120.0])
@pytest.mark.parametrize("rays", [1, 2, 32, 257])
def test_rays_fill_the_cone_evenly(field_of_view_deg: float, rays: int) -> None:
    directions = cone(math.radians(field_of_view_deg), rays)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=0), 1.0, atol=1e-12)
    np.testing.assert_array_equal(directions[:, 0], (1.0, 0.0, 0.0))
    rim = math.cos(math.radians(field_of_view_deg / 2))
    assert directions[0].min() >= rim - 1e-12
    if rays > 1:
        assert directions[0].min() == pytest.approx(rim)
    if rays > 200:
        # Of a uniform cap, the cosine is uniform, and so is the angle around.
        assert np.abs(np.mean(directions[1:], axis=1)).max() < 0.02
        halves = np.histogram(directions[0], bins=4, range=(rim, 1.0))[0]
        assert np.ptp(halves) <= 2


@pytest.mark.parametrize("distance_m", [0.05, 0.5, 3.999])
def test_a_wall_ahead_is_as_far_as_it_is(distance_m: float) -> None:
    (reading,) = readings(finder(yard(wall(distance_m))), resting(1))
    assert reading.range_m == pytest.approx(distance_m, abs=2e-6)
    assert (reading.radiation, reading.min_range_m, reading.max_range_m) == ("ultrasound", 0.0, 4.0)
    assert reading.field_of_view_rad == pytest.approx(math.radians(15))
    assert (reading.frame, reading.variance_m2) == ("sonar_link", 0.0)


def test_limits_and_failures_follow_rep_117() -> None:
    assert measured(yard()) == math.inf
    assert measured(yard(wall(4.1))) == math.inf
    assert measured(yard(wall(0.1)), min_range_m=0.2) == -math.inf
    assert math.isnan(measured(yard(wall(1.0)), dropout=1.0))
    assert math.isnan(measured(yard(), dropout=1.0))


def test_it_looks_along_its_own_x() -> None:
    made = yard(box("left", (1, 1, 1), (0, 2.5, 0.5)), wall(3.0))
    half = math.sqrt(0.5)
    assert measured(made) == pytest.approx(3.0, abs=1e-5)
    turned = Mount((0.0, 1.0, 0.5), (0.0, 0.0, 90.0))
    assert measured(made, mount=turned) == pytest.approx(1.0, abs=1e-5)
    (state,) = moving([[0.0, -1.0, 0.0]], (0.0, 0.0, half, half))
    (reading,) = finder(made).readings(state)
    assert reading.range_m == pytest.approx(2.0, abs=1e-5)


def test_sound_takes_the_nearest_of_the_cone_and_light_the_mean_of_its_spot() -> None:
    # A pole 5 degrees off the axis at 1 m, before a wall at 3 m.
    pole = box("pole", (0.04, 0.04, 20), (2.0, 0.09, 0.5))
    made = yard(pole, wall(3.0))
    assert measured(made, rays=512) == pytest.approx(0.98, abs=0.01)
    mean = measured(made, rays=512, echo="mean")
    assert 2.5 < mean < 3.0
    assert measured(made, field_of_view_deg=4.0) == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("yaw_deg", [0, 5, 7, 14, 16, 22, 24, 45])
def test_sound_is_lost_on_slanted_walls(yaw_deg: float) -> None:
    """Heard as long as the cone's rim meets it at no more than the largest incidence."""
    most, half_angle = 15.0, 7.5
    heard = yaw_deg < half_angle + most - 0.1
    found = measured(yard(wall(2.0, yaw_deg)), max_incidence_deg=most, rays=1024)
    assert math.isfinite(found) is heard
    if heard:
        # The nearest within the cone is at its rim, or on the wall's own normal.
        towards = min(yaw_deg, half_angle)
        near = 2.0 * math.cos(math.radians(yaw_deg)) / math.cos(math.radians(yaw_deg - towards))
        assert found == pytest.approx(near, rel=4e-3)
    assert math.isfinite(measured(yard(wall(2.0, yaw_deg)), rays=1024))


@pytest.mark.parametrize(
    ("material", "distance_m", "seen"),
    [("gray", 3.9, True), ("black", 1.9, True), ("black", 2.1, False)],
)
def test_light_sees_dark_surfaces_less_far(material: str, distance_m: float, seen: bool) -> None:
    found = measured(
        yard(wall(distance_m, material=material)),
        full_range_reflectivity=0.5,
        field_of_view_deg=1.0,
    )
    assert math.isfinite(found) is seen


def test_moving_towards_a_wall_the_distance_is_that_of_the_stamp() -> None:
    speed = 2.0
    ticks = np.arange(400)
    places = np.stack([speed * ticks / 400, 0 * ticks, 0 * ticks], axis=1)
    taken = readings(finder(yard(wall(3.5)), rate_hz=29.97), moving(places))
    assert len(taken) == 30
    for reading in taken:
        seconds = (reading.stamp_nanos - EPOCH_NANOS) * 1e-9
        assert reading.range_m == pytest.approx(3.5 - speed * seconds, abs=3e-6)


@pytest.mark.parametrize(
    ("noise", "sigma_m"),
    [
        ({"range_stddev_m": 0.01}, 0.01),
        ({"range_stddev_share": 0.01}, 0.02),
        ({"range_stddev_per_m": 0.01}, 0.04),
        ({"range_stddev_m": 0.03, "range_stddev_per_m": 0.01}, 0.05),
    ],
)
def test_noise_is_normal_with_its_deviation(noise: dict[str, float], sigma_m: float) -> None:
    taken = readings(
        finder(yard(wall(2.0)), rate_hz=400, field_of_view_deg=1, rays=1, **noise), resting(2000)
    )
    off = np.array([reading.range_m for reading in taken]) - 2.0
    assert stats.kstest(off / sigma_m, "norm").pvalue > 0.001
    assert 0.0005 < stats.chi2.cdf(float(np.sum(off**2)) / sigma_m**2, len(off)) < 0.9995
    assert np.mean([r.variance_m2 for r in taken]) == pytest.approx(sigma_m**2, rel=0.01)


def test_bias_is_drawn_once_for_a_run_and_rounding_comes_last() -> None:
    biased = {"turn_on_bias_m": 0.05, "rate_hz": 400, "field_of_view_deg": 1, "rays": 1}
    drawn = []
    for seed in range(60):
        taken = readings(finder(yard(wall(2.0), seed=seed), **biased), resting(3))
        assert len({reading.range_m for reading in taken}) == 1
        drawn.append(taken[0].range_m - 2.0)
    assert stats.kstest(np.array(drawn) / 0.05, "norm").pvalue > 0.001
    rounded = {"range_stddev_m": 0.05, "range_resolution_m": 0.01, "rate_hz": 400}
    taken = readings(finder(yard(wall(2.0)), **rounded), resting(100))
    steps = np.array([reading.range_m for reading in taken]) / 0.01
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert len(set(steps.tolist())) > 5


def test_failures_come_as_often_as_they_should_and_change_no_other_reading() -> None:
    noisy = {"range_stddev_m": 0.01, "rate_hz": 400}
    made, run = yard(wall(2.0)), resting(2000)
    whole = [r.range_m for r in readings(finder(made, **noisy), run)]
    some = [r.range_m for r in readings(finder(made, dropout=0.25, **noisy), run)]
    lost = np.isnan(some)
    assert stats.binomtest(int(lost.sum()), len(some), 0.25).pvalue > 0.001
    np.testing.assert_array_equal(np.array(whole)[~lost], np.array(some)[~lost])
