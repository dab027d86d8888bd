# SPDX-License-Identifier: Apache-2.0
"""Counters of wheels that err: missed ticks, errors of scale, slip."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from services.sensors.encoders.spec import Encoders
from services.sensors.runtime.wheel_counters import WheelCounters
from tests.services.sensors.states import WHEELS, scenario, states

LEFT, RIGHT = WHEELS
PER_RADIAN = 1e5
ENCODERS = Encoders(
    name="wheels",
    topic="/wheels",
    frame="base_link",
    ticks_per_revolution=round(2 * np.pi * PER_RADIAN),
)


def counted(turned_rad: float, *, seed: int = 1, **errors: Any) -> tuple[int, ...]:
    """Return the counters after both wheels have turned forward by an angle in a second."""
    run = scenario(seed=seed)
    counters = WheelCounters(run, run.vehicles[0], replace(ENCODERS, **errors))
    angles = np.linspace(0, turned_rad, 401)
    for state in states(np.zeros((401, 3)), joint_positions=np.stack([angles, angles], axis=1)):
        counters.advance(state)
    return counters.ticks()


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("turned", [(), (LEFT,), (RIGHT,), (LEFT, RIGHT)])
def test_missed_ticks_are_missing_in_each_direction_of_each_wheel(
    turned: tuple[str, ...], direction: int
) -> None:
    """A wheel that is counted backwards misses ticks as one that is counted forward does."""
    ticks = counted(10.0 * direction, missed_ticks=0.25, reversed_wheels=turned)
    signs = [-direction if name in turned else direction for name in WHEELS]
    # The standard deviation of a million ticks, of which a quarter is missed, is 433.
    assert np.multiply(ticks, signs).tolist() == pytest.approx([750_000] * 2, abs=2500)


def test_a_scale_is_an_error_of_the_run_and_of_each_wheel() -> None:
    errors = (
        np.array([counted(10.0, seed=seed, scale_stddev=0.01) for seed in range(200)]) / 1e6 - 1
    )
    assert np.std(errors, axis=0) == pytest.approx([0.01] * 2, rel=0.15)
    assert np.mean(errors, axis=0) == pytest.approx([0.0] * 2, abs=0.003)
    assert abs(np.corrcoef(errors.T)[0, 1]) < 0.2
    once, twice = counted(10.0, scale_stddev=0.01), counted(20.0, scale_stddev=0.01)
    assert np.subtract(twice, np.multiply(once, 2)).tolist() == pytest.approx([0, 0], abs=2)


def test_slip_grows_with_the_root_of_the_angle() -> None:
    for turned in (4.0, 16.0):
        errors = [counted(turned, seed=seed, slip_stddev=0.01) for seed in range(200)]
        strayed = np.array(errors) / PER_RADIAN - turned
        assert np.std(strayed, axis=0) == pytest.approx([0.01 * turned**0.5] * 2, rel=0.15)
        assert abs(np.corrcoef(strayed.T)[0, 1]) < 0.2


def test_an_eccentric_disc_errs_once_per_turn() -> None:
    strayed = np.array(
        [
            np.array(counted(turned, eccentricity_deg=1.0)) / PER_RADIAN - turned
            for turned in np.linspace(0.0, 4 * np.pi, 33)
        ]
    )
    amplitude = np.radians(1.0)
    assert strayed[[16, 32]] == pytest.approx(0.0, abs=2 / PER_RADIAN)
    assert np.ptp(strayed, axis=0) == pytest.approx([2 * amplitude] * 2, rel=0.03)
    assert np.abs(strayed[:, 0] - strayed[:, 1]).max() > amplitude / 10
    # Second harmonics are none.
    assert strayed[4] + strayed[12] == pytest.approx(strayed[0] + strayed[8], abs=4 / PER_RADIAN)


def test_a_wheel_at_rest_does_not_slip() -> None:
    assert counted(0.0, slip_stddev=1.0, scale_stddev=0.1, missed_ticks=0.5) == (0, 0)


def test_a_reset_counts_from_where_the_wheels_are_then() -> None:
    assert counted(10.0, resets_s=(0.5,)) == pytest.approx((500_000, 500_000), abs=2)
