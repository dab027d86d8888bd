# SPDX-License-Identifier: Apache-2.0
"""Curves are those of the sensors' models, and fits find the sizes that a recording shows."""

import numpy as np
import pytest

from groundlink.core.clock import TICK_SECONDS
from groundlink.fitting.allan import (
    DRIFT_PEAK,
    CurveFit,
    NoiseCurve,
    allan_table,
    fit_curves,
    gauss_markov,
    white_noise,
)
from groundlink.fitting.series import AllanBands, Series, allan_bands
from services.sensors.imu.errors import PEAK_OF_GAUSS_MARKOV
from services.sensors.imu.lowpass import weights
from services.sensors.noise.error_processes import ErrorProcesses
from services.sensors.noise.random_streams import RandomStreams
from tests.services.sensors.allan import Floats

SECONDS: Floats = TICK_SECONDS * 2.0 ** np.arange(18)
NO_BASE = NoiseCurve(0, 0, 100)
LEVELS = [("white",), ("white", "drift"), ("white", "drift", "time_s")]


@pytest.mark.parametrize("bandwidth_hz", [5, 20, 98, 200])
def test_white_noise_through_the_low_pass_of_the_model(bandwidth_hz: float) -> None:
    taps = weights(bandwidth_hz)
    for ticks in (1, 2, 5, 40, 1000):
        means = np.repeat([1 / ticks, -1 / ticks], ticks)
        expected = np.sum(np.convolve(taps, means) ** 2) / TICK_SECONDS / 2
        found = white_noise(np.array([ticks * TICK_SECONDS]), bandwidth_hz)[0]
        assert found == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(white_noise(SECONDS) * SECONDS, 1)


def test_a_drift_has_its_highest_deviation_where_the_model_says() -> None:
    assert pytest.approx(PEAK_OF_GAUSS_MARKOV, abs=1e-5) == DRIFT_PEAK
    ratio = np.geomspace(1e-2, 1e3, 500)
    continuous = 2 / ratio * (1 - (3 - 4 * np.exp(-ratio) + np.exp(-2 * ratio)) / (2 * ratio))
    np.testing.assert_allclose(gauss_markov(ratio, 1.0, 1e-5), continuous, rtol=1e-4)
    assert np.sqrt(continuous.max()) == pytest.approx(DRIFT_PEAK, rel=1e-4)
    # Readings that are samples differ more than means over the time between them.
    assert gauss_markov(np.array([0.1]), 1.0, 0.1)[0] == pytest.approx(1 - np.exp(-0.1))


def exact(curve: NoiseCurve, bands: int = 18, clusters: int = 10_000) -> AllanBands:
    """Return the bands of an endless recording."""
    variance = curve.variance(SECONDS[:bands])
    counts = np.full(bands, clusters, np.intp)
    return AllanBands(SECONDS[:bands], variance, np.stack([variance] * 3, axis=1), counts)


@pytest.mark.parametrize(
    "curve",
    [
        NoiseCurve(2e-3, 0, 100),
        NoiseCurve(2e-3, 1e-3, 30),
        NoiseCurve(2e-3, 1e-3, 10, walk=5e-5),
        NoiseCurve(2e-3, 0, 100, low_pass_hz=63.3),
        NoiseCurve(2e-3, 1e-3, 30, low_pass_hz=31.4, rounding=1e-3),
    ],
)
def test_exact_bands_give_their_curve(curve: NoiseCurve) -> None:
    choices = [
        (*levels, *low_pass)
        for low_pass in ((), ("low_pass_hz",))
        for levels in (*LEVELS, ("white", "drift", "time_s", "walk"))
    ]
    (found,) = fit_curves([exact(curve)], [NO_BASE._replace(rounding=curve.rounding)], choices)
    assert {name for name in found.fitted if name != "time_s" or curve.drift} == {
        name
        for name in ("white", "drift", "time_s", "walk", "low_pass_hz")
        if getattr(curve, name) and (name != "time_s" or curve.drift)
    }
    for name in found.errors:
        assert getattr(found.curve, name) == pytest.approx(getattr(curve, name), rel=0.06), name
    assert np.abs(found.differences).max() < 0.06  # Grids have steps of 10 %.


def test_what_a_recording_is_too_short_for_is_that_of_the_base() -> None:
    base = NoiseCurve(9e-3, 1e-4, 300, walk=1e-7)
    short = exact(NoiseCurve(2e-3, 1e-4, 300), bands=8, clusters=100)
    (found,) = fit_curves([short], [base], LEVELS)
    assert found.fitted == ("white",)
    assert found.curve == base._replace(white=found.curve.white)
    assert found.curve.white == pytest.approx(2e-3, rel=1e-3)
    # A base with a drift that the recording would show is corrected: there is none.
    (found,) = fit_curves([short], [base._replace(drift=0.3)], LEVELS)
    assert found.curve.drift < 3e-4


def test_groups_share_the_time_constant() -> None:
    curves = NoiseCurve(0.02, 0.3, 40), NoiseCurve(0.05, 0.9, 40)
    found = fit_curves([exact(curve) for curve in curves], [NO_BASE] * 2, LEVELS)
    assert found[0].curve.time_s == found[1].curve.time_s == pytest.approx(40, rel=0.06)
    assert [one.curve.drift for one in found] == pytest.approx([0.3, 0.9], rel=0.03)


def test_the_errors_of_an_error_process_are_within_the_stated_ones() -> None:
    """Twenty minutes of three axes whose drift has a time constant of 15 s."""
    drift = ErrorProcesses(
        RandomStreams(3, "x"), "drift",
        stddevs=[0.4] * 3, time_constants_s=[15] * 3, noise_source="numpy",
    )  # fmt: skip
    values = np.concatenate([drift.block(block)[::16] for block in range(3750)])
    values += 0.02 / 0.2 * np.random.default_rng(3).normal(size=values.shape)
    (found,) = fit_curves([allan_bands(Series([values], 0.04))], [NO_BASE], LEVELS)
    for name, expected in (("white", 0.02), ("drift", 0.4), ("time_s", 15)):
        assert abs(np.log(getattr(found.curve, name) / expected)) < 3 * found.errors[name], name
    assert max(found.errors.values()) < 0.3
    assert np.abs(found.differences).max() < 0.2


def test_the_table_names_bands_that_are_left_out() -> None:
    bands = exact(NoiseCurve(1e-3, 0, 100), bands=3)
    bands.variance[0] *= 3
    fit = CurveFit(bands, NoiseCurve(1e-3, 0, 100), ("white",), {"white": 0.01})
    lines = list(allan_table("the gyroscope, rad/s", fit, "xyz"))
    assert lines[0] == "Allan deviation of the gyroscope, rad/s, by averaging time:"
    assert "(-42%), has vibration, left out" in lines[1]
    assert lines[2].endswith("recorded 0.0141, fitted 0.0141 (+0%)")
    assert lines[-1] == "Axes over their mean: x 1.00, y 1.00, z 1.00."
