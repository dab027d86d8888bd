# SPDX-License-Identifier: Apache-2.0
"""Noise, holes and limits of depth found by a stereo pair, on depths made up here."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from services.sensors.depth_camera.model import measured, near_jumps, unseen_by_right_eye

from .specs import spec

FX = 400.0
STEREO: dict[str, Any] = {"encoding": "32FC1", "max_range_m": 1000.0, "baseline_m": 0.1}


def wall(depth_m: float, shape: tuple[int, int] = (240, 320)) -> NDArray[np.float32]:
    return np.full(shape, depth_m, np.float32)


def seen(truth_m: NDArray[np.float32], *, tick: int = 0, **fields: Any) -> NDArray[np.float32]:
    before = truth_m.copy()
    depth_m = measured(truth_m, FX, spec(**fields), np.random.default_rng(tick))
    assert np.array_equal(truth_m, before)
    return depth_m


def test_ideal_device_is_exact() -> None:
    truth_m = np.random.default_rng(1).uniform(0.1, 10.0, (24, 32)).astype(np.float32)
    assert np.array_equal(seen(truth_m), truth_m)


def test_the_deepest_is_the_largest_range_and_beyond_is_infinite() -> None:
    row = [0.29, 0.3, 5.0, 10.0, np.nextafter(np.float32(10.0), np.float32(11.0)), np.inf]
    depth_m = seen(np.array([row], np.float32), min_range_m=0.3, max_range_m=10.0)
    wanted = np.array([[-np.inf, 0.3, 5.0, 10.0, np.inf, np.inf]], np.float32)
    assert np.array_equal(depth_m, wanted)


def test_noise_grows_with_depth_squared() -> None:
    sigma_px = 0.08
    for depth_m in (1.0, 2.0, 4.0, 8.0, 16.0):
        inner = seen(wall(depth_m), **STEREO, disparity_stddev_px=sigma_px)[:, 60:]
        wanted = depth_m**2 / (FX * STEREO["baseline_m"]) * sigma_px
        # Of 62400 numbers, 4 sigma of their standard deviation is 1.1 %.
        assert inner.std() == pytest.approx(wanted, rel=0.02)
        assert inner.mean() == pytest.approx(depth_m, abs=0.02 * wanted + wanted**2 / depth_m)


def test_noise_is_white_and_depends_on_the_generator_only() -> None:
    first = seen(wall(4.0), tick=1, **STEREO, disparity_stddev_px=0.1)[:, 60:] - 4.0
    assert np.array_equal(
        first, seen(wall(4.0), tick=1, **STEREO, disparity_stddev_px=0.1)[:, 60:] - 4.0
    )
    other = seen(wall(4.0), tick=2, **STEREO, disparity_stddev_px=0.1)[:, 60:] - 4.0
    for a, b in ((first, other), (first[:, 1:], first[:, :-1]), (first[1:], first[:-1])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.02


def test_unmatched_pixels_are_out_of_range() -> None:
    """A disparity that noise makes negative is no depth behind the camera; the sky has none."""
    far = seen(wall(900.0), **STEREO, disparity_stddev_px=0.5)
    assert not (far < 0).any()
    assert 0.4 < np.isinf(far).mean() < 0.6
    sky = seen(wall(np.inf), **STEREO, disparity_stddev_px=0.5)
    assert np.isposinf(sky).all()


def test_the_right_eye_does_not_see_behind_a_near_thing() -> None:
    """A strip to the left of it, as wide as the disparities differ, and the picture's left rim."""
    truth_m = wall(8.0, (60, 320))
    truth_m[20:40, 150:200] = 2.0
    holes = np.isnan(seen(truth_m, **STEREO))
    far_px, near_px = (round(FX * 0.1 / z) for z in (8.0, 2.0))  # 5 and 20
    wanted = np.zeros_like(holes)
    wanted[:, :far_px] = True
    wanted[20:40, 150 - (near_px - far_px) : 150] = True
    assert np.array_equal(holes, wanted)


def test_a_slanted_surface_is_seen_by_both() -> None:
    slanted = np.tile(np.linspace(3.0, 12.0, 320, dtype=np.float32), (4, 1))
    for truth_m in (slanted, slanted[:, ::-1].copy()):
        assert not unseen_by_right_eye(40.0 / truth_m)[:, 14:].any()


@pytest.mark.parametrize("radius_px", [1, 3])
def test_holes_at_edges(radius_px: int) -> None:
    disparity_px = np.full((40, 60), 5.0, np.float32)
    disparity_px[:, 30:] = 6.5
    disparity_px[:15] += 0.9  # too little for an edge
    columns = np.arange(60)
    wanted = np.tile((columns >= 30 - radius_px) & (columns < 30 + radius_px), (40, 1))
    assert np.array_equal(near_jumps(disparity_px, radius_px), wanted)
    assert np.array_equal(near_jumps(disparity_px.T.copy(), radius_px), wanted.T)
    truth_m = 40.0 / disparity_px
    more = np.isnan(seen(truth_m, **STEREO, edge_holes_px=radius_px))
    assert more[:, 10:][wanted[:, 10:]].all()
    assert not more[:, 10:25].any()


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"min_range_m": 10.0}, "less than `max_range_m`"),
        ({"max_range_m": 70.0}, "32FC1"),
        ({"disparity_stddev_px": 0.1}, "baseline_m"),
        ({"edge_holes_px": 2}, "baseline_m"),
    ],
)
def test_conflicting_fields_are_refused(fields: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        spec(**fields)
