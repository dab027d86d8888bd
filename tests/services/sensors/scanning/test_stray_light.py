# SPDX-License-Identifier: Apache-2.0
"""Points at edges and beside retroreflectors are where and as often as geometry says."""

from typing import Any

import msgspec
import numpy as np
import pytest

from services.sensors.lidar.spec import Lidar

from . import targets

STEP_DEG = 0.2
WIDE: dict[str, Any] = {
    "firings_per_revolution": 1800,
    "divergence_mrad": [1000 * float(np.radians(STEP_DEG)) / 2, 1.0],
    "elevations_deg": np.linspace(-5, 5, 201).tolist(),
    "mixed_pixels": True,
}
"""The footprint is half an azimuth step wide."""

POST_M, WALL_M = 10.0, 10.4


def post(name: str = "post") -> Any:
    """A white post in front of a gray wall, 0.4 m apart: less than half a pulse."""
    return targets.box("white", (POST_M + 0.05, 0, 0), (0.1, 0.52, 9), name)


def test_half_of_the_edges_make_a_point_between_the_surfaces() -> None:
    gray = targets.wall("gray", WALL_M)
    got, plain = (
        targets.returns(post(), gray, **WIDE | {"mixed_pixels": m}) for m in (True, False)
    )
    assert got.returned.all()
    changed = np.abs(got.true_range_m - plain.true_range_m)[0] > 1e-4
    # Two edges for each laser, each of which a footprint covers with probability 1/2.
    edges = 2 * len(WIDE["elevations_deg"])
    assert changed.sum() == pytest.approx(edges / 2, abs=5 * np.sqrt(edges / 4))
    assert changed.any(axis=1).mean() == pytest.approx(0.75, abs=0.12)
    # Near and far surfaces keep at least half of the footprint.
    between = got.true_range_m[0][changed]
    assert (between > POST_M - 1e-3).all()
    assert (between < WALL_M * 1.02).all()
    on_post = plain.true_range_m[0][changed] < POST_M + 0.1
    assert 0.3 < on_post.mean() < 0.7
    # A share f of the other surface, even from 0 to 1/2, gives the mean weighted by power.
    power = np.array([1 / POST_M**2, 0.5 / WALL_M**2])
    share = np.linspace(0, 0.5, 1001)
    expected = POST_M + (WALL_M - POST_M) * share * power[1] / (
        (1 - share) * power[0] + share * power[1]
    )
    assert between[on_post].mean() == pytest.approx(expected.mean(), abs=0.02)
    intensity = got.intensity[0][changed][on_post]
    assert intensity.min() < 80
    assert intensity.max() <= 100


def test_surfaces_a_pulse_apart_give_two_returns() -> None:
    far = targets.wall("gray", 14.0)
    dual = targets.returns(post(), far, **WIDE, returns="dual")
    both = dual.returned.all(axis=0)
    edges = 2 * len(WIDE["elevations_deg"])
    assert both.sum() == pytest.approx(edges / 2, abs=5 * np.sqrt(edges / 4))
    assert (dual.true_range_m[0][both] > 13.9).all()
    assert (dual.true_range_m[1][both] < 10.2).all()
    strongest = targets.returns(post(), far, **WIDE)
    assert strongest.returned.all()
    between = (strongest.true_range_m > 10.2) & (strongest.true_range_m < 13.9)
    assert not between.any()


def test_before_the_sky_a_silhouette_is_darker_and_a_little_wider() -> None:
    got, plain = (targets.returns(post(), **WIDE | {"mixed_pixels": m}) for m in (True, False))
    assert plain.intensity[plain.returned].min() == 100
    wider = got.returned & ~plain.returned
    assert not (plain.returned & ~got.returned).any()
    edges = 2 * len(WIDE["elevations_deg"])
    assert wider.sum() == pytest.approx(edges / 4, abs=5 * np.sqrt(edges / 4))
    assert got.intensity[wider].max() <= 50
    dimmer = plain.returned & (got.intensity < 100)
    assert dimmer.sum() == pytest.approx(edges / 4, abs=5 * np.sqrt(edges / 4))
    assert got.intensity[dimmer].min() >= 50


def test_slanted_and_folded_surfaces_have_no_mixed_pixels() -> None:
    side = targets.box("gray", (0, 3.0, 0), (400, 1, 400), "side")
    other = targets.box("gray", (20.5, 0, 0), (1, 400, 400), "ahead")
    aside = {"start_deg": 40.0, "field_of_view_deg": 37.0}
    got, plain = (
        targets.returns(side, other, **WIDE | aside | {"mixed_pixels": m}) for m in (True, False)
    )
    assert np.ptp(plain.true_range_m) > 5
    np.testing.assert_array_equal(got.true_range_m, plain.true_range_m)
    np.testing.assert_array_equal(got.intensity, plain.intensity)


SIGN_DEG = 2.0
BLOOMING: dict[str, Any] = {
    "firings_per_revolution": 3600,
    "elevations_deg": np.linspace(-4, 4, 41).tolist(),
    "divergence_mrad": [2.0, 2.0],
    "blooming": {"share": 0.001, "width_mrad": 10.0},
    "full_range_reflectivity": 0.1,
}


def sign(distance_m: float = 10.0) -> Any:
    size = 2 * distance_m * np.tan(np.radians(SIGN_DEG / 2))
    return targets.box("sign", (distance_m + 0.01, 0, 0), (0.02, size, size), "sign")


def beyond_rad(made: Any) -> np.ndarray:
    """Return the angle of each beam to the nearest beam that hits the sign."""
    x, y, z = targets.scanner(made).sweep.directions_in_sensor.astype(np.float64)
    half = np.tan(np.radians(SIGN_DEG / 2))
    out = np.hypot(*(np.maximum(np.abs(c / x) - half, 0) for c in (y, z)))
    return np.arctan(out)


def test_a_retroreflector_blooms() -> None:
    made = targets.scenario(sign(), **BLOOMING)
    got, plain = (
        targets.measured(targets.scenario(sign(), **BLOOMING | {"blooming": b}))
        for b in (BLOOMING["blooming"], None)
    )
    halo = (got.returned & ~plain.returned)[0]
    beyond = beyond_rad(made)
    assert halo.any()
    assert got.true_range_m[0][halo] == pytest.approx(10.0, abs=0.1)
    # 0.1 % of 1000 times white's light at the footprint's edge, e less each 10 mrad.
    expected = 100 * np.exp(-np.maximum(beyond - 1e-3, 0) / 10e-3)
    # Beams stand 1.75 mrad apart in azimuth and 3.5 in elevation, so the nearest hit is farther.
    assert (got.intensity[0][halo] <= np.rint(expected[halo]) + 1).all()
    assert (got.intensity[0][halo] >= 0.6 * expected[halo] - 1).all()
    # Above the threshold of 10 % at 100 m, 0.1 % at 10 m: all that is looked for, above 1 %.
    reach = 1e-3 + 10e-3 * np.log(100)
    assert halo[(beyond > 0.002) & (beyond < 0.9 * reach)].all()
    assert not halo[beyond > reach].any()
    # What is hit itself is the same.
    np.testing.assert_array_equal(got.intensity[plain.returned], plain.intensity[plain.returned])


def test_a_stronger_wall_hides_the_halo_and_one_beside_it_brightens() -> None:
    near = targets.returns(sign(), targets.wall("white", 12.0), **BLOOMING)
    shares = [(np.abs(near.true_range_m[0] - distance) < 0.3).mean() for distance in (10.0, 12.1)]
    assert min(shares) > 0.05
    flush = targets.wall("dark", 10.01)
    bright = targets.returns(sign(), flush, **BLOOMING).intensity[0]
    assert np.unique(targets.returns(sign(), flush, **BLOOMING | {"blooming": None}).intensity)[
        0
    ] == pytest.approx(10)
    assert ((bright > 12) & (bright <= 110)).mean() > 0.05


def test_without_a_retroreflector_nothing_blooms() -> None:
    wall = targets.wall("white", 10.0)
    got, plain = (
        targets.returns(wall, **BLOOMING | {"blooming": b}) for b in (BLOOMING["blooming"], None)
    )
    for one, other in zip(got, plain, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mixed_pixels": True}, "`mixed_pixels` needs a width"),
        (
            {"mixed_pixels": True, "divergence_mrad": [3.0, 3.0], "rays_per_beam": 4},
            "`mixed_pixels` needs .* got 3 and 4",
        ),
        (
            {
                "blooming": {"share": 0.1, "width_mrad": 1},
                "divergence_mrad": [3.0, 3.0],
                "rays_per_beam": 4,
            },
            "`blooming` needs `rays_per_beam: 1`; got 4",
        ),
    ],
)
def test_options_that_do_not_fit_are_refused(change: dict[str, Any], message: str) -> None:
    made = {"name": "l", "topic": "/l", "frame": "l", "elevations_deg": [0.0]}
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.convert(made | change, Lidar)
