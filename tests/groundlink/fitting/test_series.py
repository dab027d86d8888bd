# SPDX-License-Identifier: Apache-2.0
"""Readings become segments at a steady rate; their Allan variance is that of the definition."""

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.fitting.series import Series, allan_bands, of_samples, step
from tests.services.sensors.allan import Floats, allan_deviation


def white(count: int = 4000, axes: int = 3, seed: int = 1) -> Floats:
    return np.random.default_rng(seed).normal(size=(count, axes))


def test_a_gap_begins_a_segment_and_a_lost_reading_does_not() -> None:
    times: Floats = np.arange(1000) * 0.01
    times[500:] += 5
    kept = np.delete(np.arange(1000), [100, 700])
    series = of_samples(times[kept], white(1000)[kept], "x")
    assert [len(segment) for segment in series.segments] == [499, 499]
    assert series.period_s == pytest.approx(0.01, rel=1e-3)
    assert series.seconds == pytest.approx(9.98, rel=1e-3)


def test_scattered_repeated_and_unknown_readings() -> None:
    times: Floats = np.arange(1000) * 0.025
    times += np.random.default_rng(2).uniform(-0.003, 0.003, 1000)
    times[300] = times[299]
    values = white(1000)
    values[600] = np.nan
    series = of_samples(times, values, "x")
    assert series.readings == 998
    assert series.period_s == pytest.approx(0.025, rel=2e-3)


def test_too_few_readings_are_refused() -> None:
    with pytest.raises(UserError, match=r"x: 99 readings; expected at least 100"):
        of_samples(np.arange(99.0), white(99), "x")


def test_halves_and_axes() -> None:
    values = white(1000, 6)
    series = Series([values[:300], values[300:]], 0.01)
    first, second = series.halves()
    assert [len(one) for one in first.segments] == [300, 200]
    np.testing.assert_array_equal(np.concatenate(second.segments), values[500:])
    np.testing.assert_array_equal(series.axes(3, 6).segments[1], values[300:, 3:])


def test_the_variance_is_that_of_the_definition_with_an_offset_in_each_segment() -> None:
    values = white()
    bands = allan_bands(Series([values], 0.01))
    assert bands.seconds.tolist() == [0.01 * 2**i for i in range(9)]
    assert bands.clusters.tolist() == [4000 // 2**i for i in range(9)]
    for band, seconds in enumerate(bands.seconds):
        expected = allan_deviation(values, 100, seconds) ** 2
        np.testing.assert_allclose(bands.by_axis[band], expected, rtol=1e-9)
        assert bands.variance[band] == pytest.approx(expected.mean(), rel=1e-9)
    moved = Series([values[:2000], values[2000:] + 1e6], 0.01)
    np.testing.assert_allclose(allan_bands(moved).variance[:5], bands.variance[:5], rtol=0.02)


def test_readings_faster_than_a_tick_are_averaged_over_one() -> None:
    bands = allan_bands(Series([white()], 0.001))
    np.testing.assert_allclose(bands.seconds[:3], [0.003, 0.006, 0.012])


def test_a_vibration_is_no_noise() -> None:
    values = white()
    assert allan_bands(Series([values], 0.01)).is_noise.all()
    shaken = values + 3 * np.sin(2 * np.pi * 48 * np.arange(4000) * 0.01)[:, None]
    assert allan_bands(Series([shaken], 0.01)).is_noise.tolist() == [False] + [True] * 8


@pytest.mark.parametrize(("size", "offset"), [(0.01, 0.0), (0.0625, 0.003), (2.5e-4, 9.81)])
def test_the_step_of_rounded_values(size: float, offset: float) -> None:
    values = 5 * size * white(5000, 1)[:, 0]
    assert step(np.rint(values / size) * size + offset) == pytest.approx(size, rel=1e-3)
    assert step((np.rint(values / size) * size + offset).astype(np.float32)) == pytest.approx(
        size, rel=1e-3
    )
    assert step(values + offset) == 0
    assert step(np.full(1000, offset)) == 0
