# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from services.sensors.wheel_odometry.reckoning import Reckoning

TRACK_M = 0.6


STEP_S = 0.02


def reckoning(
    travel_stddevs: tuple[float, float] = (0.0, 0.0),
    constant_stddevs: tuple[float, ...] = (0.0,) * 5,
) -> Reckoning:
    return Reckoning(
        track_m=TRACK_M, travel_stddevs=travel_stddevs, constant_stddevs=constant_stddevs
    )


def test_equal_travels_are_a_straight_line() -> None:
    model = reckoning()
    for _ in range(10):
        assert model.step(0.1, 0.1, STEP_S)[:2] == (0.1, 0.0)
    assert (model.pose.x_m, model.pose.y_m, model.pose.yaw_rad) == (pytest.approx(1.0), 0.0, 0.0)


def test_the_right_side_farther_is_a_turn_to_the_left() -> None:
    model = reckoning()
    way, turn, _ = model.step(0.1, 0.1 + 0.2 * TRACK_M, STEP_S)
    assert turn == pytest.approx(0.2)
    assert way == pytest.approx(0.1 + 0.1 * TRACK_M)
    # The chord of an arc points to where half of the turn has been made.
    assert math.atan2(model.pose.y_m, model.pose.x_m) == pytest.approx(0.1)


def test_a_circle_of_small_steps_closes() -> None:
    model, steps, radius = reckoning(), 2000, 1.5
    turn = 2 * math.pi / steps
    for _ in range(steps):
        model.step((radius - TRACK_M / 2) * turn, (radius + TRACK_M / 2) * turn, STEP_S)
    assert math.hypot(model.pose.x_m, model.pose.y_m) < 1e-9
    assert model.pose.yaw_rad == pytest.approx(0, abs=1e-9)


def test_opposite_travels_turn_on_the_spot() -> None:
    model = reckoning()
    for _ in range(10):
        model.step(-0.05 * TRACK_M, 0.05 * TRACK_M, STEP_S)
    assert model.pose.yaw_rad == pytest.approx(1.0)
    assert (model.pose.x_m, model.pose.y_m) == (0.0, 0.0)


def test_the_covariance_is_that_of_many_runs() -> None:
    """Monte Carlo: travels with the errors that the model believes in, along a bent way."""
    random = np.random.default_rng(3)
    steps, runs = 40, 4000
    travel_left, travel_right, scales = 0.01, 0.007, (0.01, 0.006, 0.03, 0.02, 0.04)
    model = reckoning((travel_left, travel_right), scales)
    constants = random.normal(size=(5, runs)) * np.array([scales]).T
    of_left, of_right, of_track, skid_along, skid_aside = constants
    lefts = np.full(steps, 0.05)
    rights = 0.05 + 0.02 * np.sin(np.arange(steps) / 6)
    x = y = yaw = np.zeros(runs)
    for left, right in zip(lefts, rights, strict=True):
        model.step(left, right, STEP_S)
        l_run = left * (1 + of_left) + travel_left * np.sqrt(left) * random.normal(size=runs)
        r_run = right * (1 + of_right) + travel_right * np.sqrt(right) * random.normal(size=runs)
        turn, way = (r_run - l_run) / TRACK_M * (1 + of_track), (l_run + r_run) / 2
        skid = way * turn / STEP_S
        ahead, aside = way + skid_along * abs(skid), skid_aside * skid
        along, across = np.cos(yaw + turn / 2), np.sin(yaw + turn / 2)
        x, y = x + ahead * along - aside * across, y + ahead * across + aside * along
        yaw = yaw + turn
    found, said = np.cov([x, y, yaw]), model.covariance()
    sigma = np.sqrt(np.diag(said))
    assert (sigma > 1e-3).all()
    # Relative to both sigmas, so that small correlations count little; second order is left out.
    np.testing.assert_allclose(
        found / np.outer(sigma, sigma), said / np.outer(sigma, sigma), atol=0.08
    )


def test_without_errors_it_is_sure() -> None:
    model = reckoning()
    model.step(0.1, 0.3, STEP_S)
    assert not np.any(model.covariance())


def test_its_derivatives_are_those_of_its_steps() -> None:
    """Large steps on bent paths: finite differences by the travels and by the track."""

    def end(*scales: float) -> NDArray[np.float64]:
        left, right, track = scales
        model = Reckoning(
            track_m=TRACK_M / track, travel_stddevs=(0.0, 0.0), constant_stddevs=(0.0,) * 5
        )
        for step in ((0.5, 0.8), (0.9, 0.4), (-0.3, 0.2)):
            model.step(left * step[0], right * step[1], STEP_S)
        return np.array([model.pose.x_m, model.pose.y_m, model.pose.yaw_rad])

    model = reckoning()
    for step in ((0.5, 0.8), (0.9, 0.4), (-0.3, 0.2)):
        model.step(*step, STEP_S)
    small = 1e-6
    by_scales = np.array(model.pose.by_constants)[:, :3]
    for i, column in enumerate(by_scales.T):
        scales = np.ones(3)
        scales[i] += small
        np.testing.assert_allclose((end(*scales) - end(1, 1, 1)) / small, column, atol=1e-5)


def test_white_errors_of_one_large_step_are_those_of_its_derivatives() -> None:
    model, small, step = reckoning((0.1, 0.2)), 1e-6, np.array([0.5, 0.9])
    model.step(*step, STEP_S)
    ends = []
    for changed in (step, np.add(step, (small, 0)), np.add(step, (0, small))):
        other = reckoning()
        other.step(*changed, STEP_S)
        ends.append([other.pose.x_m, other.pose.y_m, other.pose.yaw_rad])
    by_travels = (np.array(ends[1:]) - ends[0]).T / small
    expected = by_travels @ np.diag(np.square([0.1, 0.2]) * step) @ by_travels.T
    np.testing.assert_allclose(model.covariance(), expected, atol=1e-7)
