# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest

from services.sensors.wheel_odometry.reckoning import Reckoning

TRACK_M = 0.6


def reckoning(travel_stddev: float = 0.0, turn_stddev: float = 0.0) -> Reckoning:
    return Reckoning(track_m=TRACK_M, travel_stddev=travel_stddev, turn_stddev=turn_stddev)


def test_equal_travels_are_a_straight_line() -> None:
    model = reckoning()
    for _ in range(10):
        assert model.step(0.1, 0.1)[:2] == (0.1, 0.0)
    assert (model.pose.x_m, model.pose.y_m, model.pose.yaw_rad) == (pytest.approx(1.0), 0.0, 0.0)


def test_the_right_side_farther_is_a_turn_to_the_left() -> None:
    model = reckoning()
    way, turn, _ = model.step(0.1, 0.1 + 0.2 * TRACK_M)
    assert turn == pytest.approx(0.2)
    assert way == pytest.approx(0.1 + 0.1 * TRACK_M)
    # The chord of an arc points to where half of the turn has been made.
    assert math.atan2(model.pose.y_m, model.pose.x_m) == pytest.approx(0.1)


def test_a_circle_of_small_steps_closes() -> None:
    model, steps, radius = reckoning(), 2000, 1.5
    turn = 2 * math.pi / steps
    for _ in range(steps):
        model.step((radius - TRACK_M / 2) * turn, (radius + TRACK_M / 2) * turn)
    assert math.hypot(model.pose.x_m, model.pose.y_m) < 1e-9
    assert model.pose.yaw_rad == pytest.approx(0, abs=1e-9)


def test_opposite_travels_turn_on_the_spot() -> None:
    model = reckoning()
    for _ in range(10):
        model.step(-0.05 * TRACK_M, 0.05 * TRACK_M)
    assert model.pose.yaw_rad == pytest.approx(1.0)
    assert (model.pose.x_m, model.pose.y_m) == (0.0, 0.0)


def test_the_covariance_is_that_of_many_runs() -> None:
    """Monte Carlo: travels with the errors that the model believes in, along a bent way."""
    random = np.random.default_rng(3)
    steps, runs, travel, turning = 40, 4000, 0.01, 0.05
    model = reckoning(travel, turning)
    lefts = np.full(steps, 0.05)
    rights = 0.05 + 0.02 * np.sin(np.arange(steps) / 6)
    x = y = yaw = np.zeros(runs)
    for left, right in zip(lefts, rights, strict=True):
        model.step(left, right)
        l_run = left + travel * np.sqrt(left) * random.normal(size=runs)
        r_run = right + travel * np.sqrt(right) * random.normal(size=runs)
        skid = turning * np.sqrt(abs(right - left) / TRACK_M) * random.normal(size=runs)
        turn, way = (r_run - l_run) / TRACK_M + skid, (l_run + r_run) / 2
        x, y, yaw = x + way * np.cos(yaw + turn / 2), y + way * np.sin(yaw + turn / 2), yaw + turn
    found, said = np.cov([x, y, yaw]), np.array(model.pose.covariance)
    sigma = np.sqrt(np.diag(said))
    assert (sigma > 1e-3).all()
    # Relative to both sigmas, so that small correlations count little; second order is left out.
    np.testing.assert_allclose(
        found / np.outer(sigma, sigma), said / np.outer(sigma, sigma), atol=0.08
    )


def test_without_errors_it_is_sure() -> None:
    model = reckoning()
    model.step(0.1, 0.3)
    assert not np.any(model.pose.covariance)
