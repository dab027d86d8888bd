# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy import signal

from services.sensors.imu.lowpass import Butterworth, low_pass, weights

RATE_HZ = 400


@pytest.mark.parametrize("bandwidth_hz", [5, 20, 44, 98, 188])
def test_a_step_is_answered_as_by_the_continuous_butterworth(bandwidth_hz: float) -> None:
    b, a = signal.butter(2, 2 * np.pi * bandwidth_hz, analog=True)
    time = np.arange(1, 201) / RATE_HZ
    _, expected = signal.step((b, a), T=np.concatenate([[0], time]))
    taps = np.concatenate([weights(bandwidth_hz), np.zeros(200)])
    np.testing.assert_allclose(np.cumsum(taps)[:200], expected[1:], atol=1e-8)


@pytest.mark.parametrize("bandwidth_hz", [10, 20, 44])
def test_at_the_bandwidth_half_the_power_is_left(bandwidth_hz: float) -> None:
    _, response = signal.freqz(weights(bandwidth_hz), worN=[0.0, bandwidth_hz], fs=RATE_HZ)
    assert abs(response[0]) == pytest.approx(1, abs=1e-12)
    # What is held for a tick before and after adds little as long as a tick is short.
    assert abs(response[1]) == pytest.approx(np.sqrt(0.5), rel=0.04)


def test_each_triad_has_its_own_filter_and_it_is_the_convolution() -> None:
    model = Butterworth([20, 20, 20, 98, 98, 98])
    values = np.random.default_rng(3).normal(size=(300, 6))
    out = [row for row in (model.filtered(list(v)) for v in values) if row is not None]
    assert model.ticks == len(weights(20))
    assert len(out) == 300 - model.ticks + 1
    for column, bandwidth_hz in ((0, 20), (5, 98)):
        expected = np.convolve(values[:, column], weights(bandwidth_hz))[model.ticks - 1 : 300]
        np.testing.assert_allclose(np.array(out)[:, column], expected, atol=1e-12)


def test_without_a_bandwidth_nothing_is_touched() -> None:
    assert low_pass(0, 0).filtered([1.0] * 6) == [1.0] * 6
    assert low_pass(0, 20).filtered([1.0] * 6) is None
