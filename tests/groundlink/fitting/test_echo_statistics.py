# SPDX-License-Identifier: Apache-2.0
"""Statistics of firings give back the errors that were put in."""

import numpy as np
import pytest

from groundlink.fitting import echo_statistics as statistics
from groundlink.fitting.firings import Firings

from . import rooms


@pytest.mark.parametrize(("white_m", "dark_m"), [(0.005, 0.013), (0.02, 0.01)])
def test_noise_is_found_by_intensity_and_range(white_m: float, dark_m: float) -> None:
    noise = statistics.noise_bands(statistics.find_windows(rooms.measured(white_m, dark_m)))
    assert noise.intensity == pytest.approx([rooms.DARK, rooms.WHITE])
    dark, white = (row[np.isfinite(row)] for row in noise.value)
    assert len(dark) >= 1
    assert len(white) >= 2
    assert dark == pytest.approx(dark_m, rel=0.12)
    assert white == pytest.approx(white_m, rel=0.12)
    assert ((noise.range_m >= 4) & (noise.range_m <= 11)).all()


def test_edges_do_not_count_and_mixtures_are_left_out() -> None:
    firings = rooms.measured(0.005, 0.005)
    source = np.random.default_rng(2)
    posts = source.random(len(firings.range_m)) < 0.02
    with_posts = firings.range_m - 1.5 * posts[:, None]
    noise = statistics.noise_bands(statistics.find_windows(firings._replace(range_m=with_posts)))
    assert noise.value[np.isfinite(noise.value)] == pytest.approx(0.005, rel=0.12)
    grass = 0.05 * source.normal(size=firings.range_m.shape) * (np.arange(16) % 2)
    rough = firings._replace(range_m=firings.range_m + grass)
    assert not statistics.noise_bands(statistics.find_windows(rough)).value.size


def test_the_expected_noise_is_that_of_a_mixture() -> None:
    windows = statistics.find_windows(rooms.measured(0.005, 0.005))
    count = len(windows.laser)
    sigma = np.where(np.arange(count) % 2, 0.004, 0.006)
    drawn = np.random.default_rng(1).exponential(size=count) * sigma**2
    expected = statistics.expected_noise(windows, sigma**2).value
    got = statistics.noise_bands(windows._replace(variance_m2=drawn)).value
    np.testing.assert_allclose(got, expected, rtol=0.06)
    assert np.nanmax(expected) < 0.006
    assert np.nanmin(expected) > 0.004


def test_lost_returns_are_counted_by_band() -> None:
    firings = rooms.measured(0.005, 0.01, lost=0.08)
    dropout = statistics.dropout_bands(statistics.find_shots(firings, 0.03))
    dark, white = (row[np.isfinite(row)] for row in dropout.value)
    assert dark == pytest.approx(0.08, abs=0.02)
    assert (white == 0).all()


def test_gaps_are_no_lost_returns() -> None:
    """Beside a window that returns nothing, firings have no neighbors on both sides."""
    firings = rooms.measured(0.005, 0.01)
    firings.range_m[500:504] = 0
    assert not statistics.find_shots(firings, 0.03).is_lost.any()


@pytest.mark.parametrize("step_m", [0.002, 0.004, 0.0])
def test_the_quantization_step_is_found(step_m: float) -> None:
    firings = rooms.measured(0.01, 0.01, step_m=step_m)
    assert statistics.quantization_m(firings) == pytest.approx(step_m)
    as_floats = firings._replace(range_m=firings.range_m.astype(np.float32).astype(float))
    assert statistics.quantization_m(as_floats) == pytest.approx(step_m, abs=1e-6)


def test_noise_that_grows_with_slant_is_told_from_that_of_bands() -> None:
    firings = rooms.exact()
    slope = np.gradient(firings.range_m, rooms.STEP_RAD, axis=0)
    sigma = np.hypot(0.005, 0.001 * slope)
    noisy = firings.range_m + np.random.default_rng(3).normal(size=slope.shape) * sigma
    windows = statistics.find_windows(firings._replace(range_m=noisy))
    rows = statistics.noise_by_incidence(windows, statistics.noise_bands(windows))
    degrees, ratios = np.array(rows)[:, 0], np.array(rows)[:, 1]
    assert (np.diff(degrees) > 0).all()
    assert ratios[-1] > 1.2 * ratios[:2].max()
    even = statistics.find_windows(rooms.measured(0.01, 0.01))
    level = statistics.noise_by_incidence(even, statistics.noise_bands(even))
    assert [ratio for _, ratio, _ in level] == pytest.approx([1.0] * len(level), abs=0.12)
    light = statistics.intensity_by_incidence(even)
    assert {median for _, median, _ in light} <= {rooms.DARK, rooms.WHITE}
    assert {spread for *_, spread in light} == {0.0}


def test_too_few_firings_have_no_statistics() -> None:
    few = Firings(np.ones((3, 2)), np.ones((3, 2)), 0.01)
    assert not len(statistics.find_windows(few).laser)
    assert not len(statistics.find_shots(few, 1.0).is_lost)
    assert statistics.quantization_m(few) == 0
