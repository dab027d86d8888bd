# SPDX-License-Identifier: Apache-2.0
"""Noise of the image sensor: how it grows with light and gain, where black is, and its seed."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario.cameras import Imager
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.optics.imager import Electronics

SHAPE = (120, 200, 3)


def electronics(*, sensor: str = "rover/camera", **fields: Any) -> Electronics:
    return Electronics(Imager(**fields), int(np.prod(SHAPE)), RandomStreams(1, sensor))


def flat(value: int) -> NDArray[np.uint8]:
    return np.full(SHAPE, value, np.uint8)


def linear(pixels: NDArray[np.uint8]) -> Floats:
    return (pixels.astype(np.float64) / 255) ** 2


@pytest.mark.parametrize("value", [60, 128, 200])
@pytest.mark.parametrize("gain", [1.0, 4.0])
@pytest.mark.parametrize("read_noise", [0.0, 8.0])
def test_variance_grows_with_light_and_gain(value: int, gain: float, read_noise: float) -> None:
    well = 2000.0
    camera = electronics(full_well_electrons=well, gain=gain, read_noise_electrons=read_noise)
    light = linear(camera.read(flat(value), 7))
    signal = (value / 255) ** 2
    wanted = signal * gain / well + (gain * read_noise / well) ** 2
    # Rounding to whole coded values adds a twelfth of a step's square.
    step = 2 * np.sqrt(signal) / 255
    assert light.var() == pytest.approx(wanted + step**2 / 12, rel=0.04)
    assert light.mean() == pytest.approx(signal, rel=0.01)


def test_black_level_is_what_dark_pixels_say() -> None:
    assert (electronics().read(flat(0), 0) == 0).all()
    dark = linear(electronics(black_level=0.04).read(flat(0), 0))
    assert dark == pytest.approx(np.full(SHAPE, 0.04), abs=0.001)
    # Above it, noise of darkness is seen whole; without it, its lower half is cut off.
    noisy = {"full_well_electrons": 1000.0, "read_noise_electrons": 10.0}
    assert (electronics(black_level=0.04, **noisy).read(flat(0), 0) == 0).mean() < 0.001
    assert (electronics(**noisy).read(flat(0), 0) == 0).mean() == pytest.approx(0.5, abs=0.02)


def test_an_ideal_sensor_changes_nothing() -> None:
    every = np.arange(np.prod(SHAPE), dtype=np.uint8).reshape(SHAPE)
    assert electronics().read(every, 3) is every
    quiet = electronics(full_well_electrons=1e12)
    assert np.array_equal(quiet.read(every, 3), every)


def test_noise_is_that_of_seed_sensor_and_tick() -> None:
    noisy = {"full_well_electrons": 2000.0}
    once = electronics(**noisy).read(flat(128), 40)
    camera = electronics(**noisy)
    camera.read(flat(128), 39)
    assert np.array_equal(camera.read(flat(128), 40), once)
    for other in (
        camera.read(flat(128), 41),
        electronics(sensor="rover/rear", **noisy).read(flat(128), 40),
    ):
        same = np.corrcoef(once.ravel(), other.ravel())[0, 1]
        assert abs(same) < 0.03


def test_neighbors_and_colors_have_their_own_noise() -> None:
    read = electronics(full_well_electrons=2000.0).read(flat(128), 1).astype(np.float64)
    for other in (read[1:, :, :], read[:, 1:, :], read[..., 1:]):
        rows, columns, colors = other.shape
        beside = read[:rows, :columns, :colors]
        assert abs(np.corrcoef(other.ravel(), beside.ravel())[0, 1]) < 0.03


@pytest.mark.parametrize(
    ("fields", "brightness"),
    [
        ({}, 1.0),
        ({"exposure_s": 0.01}, 1.0),
        ({"exposure_s": 0.02}, 2.0),
        ({"gain": 3.0}, 3.0),
        ({"exposure_s": 0.005, "gain": 4.0}, 2.0),
    ],
)
def test_brightness_is_exposure_by_gain(fields: dict[str, float], brightness: float) -> None:
    assert electronics(**fields).brightness == pytest.approx(brightness)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"read_noise_electrons": 3.0}, "full_well_electrons"),
        ({"poses": 4}, "exposure_s"),
        ({"readout_s": 0.01}, "poses"),
    ],
)
def test_conflicting_fields_are_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        Imager(**fields)
