# SPDX-License-Identifier: Apache-2.0
"""Rows that are exposed at different times, and for a time: by a bar that moves."""

import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario.cameras import Imager
from services.sensors.rendering.optics.shutter import Shutter, weights

SHAPE = (60, 200, 3)
PIXELS_A_SECOND = 2000.0


def bar(nanos: int) -> NDArray[np.uint8]:
    """Return a bright column of 4 pixels that moves to the right."""
    picture = np.zeros(SHAPE, np.uint8)
    left = 20 + round(PIXELS_A_SECOND * nanos * 1e-9)
    picture[:, left : left + 4] = 200
    return picture


def middles(picture: NDArray[np.uint8]) -> Floats:
    """Return where the light of each row is in its mean."""
    light = (picture[..., 0] / 255.0) ** 2
    columns: Floats = light @ np.arange(SHAPE[1]) / light.sum(axis=1)
    return columns


def lengths(picture: NDArray[np.uint8]) -> NDArray[np.int64]:
    return np.count_nonzero(picture[..., 0], axis=1)


def test_an_instant_is_one_picture_unchanged() -> None:
    drawn = bar(0)
    assert Shutter(Imager(), SHAPE[0]).exposed(lambda _: drawn) is drawn


def test_one_pose_is_the_middle_of_the_exposure() -> None:
    picture = Shutter(Imager(exposure_s=0.02), SHAPE[0]).exposed(bar)
    assert np.array_equal(picture, bar(10_000_000))


@pytest.mark.parametrize("exposure_s", [0.01, 0.02])
def test_motion_blur_is_as_long_as_the_way_in_the_exposure(exposure_s: float) -> None:
    """With a pose for each pixel of the way, at most."""
    way = round(PIXELS_A_SECOND * exposure_s)
    picture = Shutter(Imager(exposure_s=exposure_s, poses=way), SHAPE[0]).exposed(bar)
    assert set(lengths(picture)) <= {way + 3, way + 4}
    assert middles(picture) == pytest.approx(np.full(SHAPE[0], 20 + way / 2 + 1.5), abs=0.6)
    # Light is spread and not lost.
    light = ((picture[..., 0] / 255.0) ** 2).sum(axis=1)
    assert light == pytest.approx(np.full(SHAPE[0], 4 * (200 / 255) ** 2), rel=0.02)


def test_rolling_shutter_shears() -> None:
    readout_s = 0.03
    picture = Shutter(Imager(readout_s=readout_s, poses=60), SHAPE[0]).exposed(bar)
    assert set(lengths(picture)) == {4}
    wanted = 21.5 + np.linspace(0, PIXELS_A_SECOND * readout_s, SHAPE[0])
    assert middles(picture) == pytest.approx(wanted, abs=1.1)


def test_both_at_once() -> None:
    spec = Imager(readout_s=0.02, exposure_s=0.01, poses=60)
    shutter = Shutter(spec, SHAPE[0])
    assert shutter.span_nanos == 30_000_000
    picture = shutter.exposed(bar)
    assert set(lengths(picture)) <= {22, 23, 24, 25}
    wanted = 21.5 + np.linspace(0, PIXELS_A_SECOND * 0.02, SHAPE[0]) + PIXELS_A_SECOND * 0.005
    assert middles(picture) == pytest.approx(wanted, abs=1.1)


@pytest.mark.parametrize("poses", [1, 2, 7, 64])
@pytest.mark.parametrize(("exposure_s", "readout_s"), [(0.01, 0.0), (0.0, 0.03), (0.004, 0.03)])
def test_every_row_gets_all_its_light(poses: int, exposure_s: float, readout_s: float) -> None:
    if poses == 1:
        readout_s, exposure_s = 0.0, 0.01
    for height in (16, 61):  # fewer rows than poses, too
        spec = Imager(exposure_s=exposure_s, readout_s=readout_s, poses=poses)
        shares = weights(spec, height)
        assert shares.shape == (poses, height)
        assert shares.sum(axis=0) == pytest.approx(np.ones(height), abs=1e-4)
        still = np.full((height, 8, 3), 77, np.uint8)
        assert np.array_equal(Shutter(spec, height).exposed(lambda _, s=still: s), still)


def test_a_picture_of_one_view_is_still() -> None:
    assert Shutter(Imager(), SHAPE[0]).is_still
    assert Shutter(Imager(exposure_s=0.02), SHAPE[0]).is_still
    assert not Shutter(Imager(exposure_s=0.02, poses=4), SHAPE[0]).is_still
