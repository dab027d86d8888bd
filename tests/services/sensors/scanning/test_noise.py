# SPDX-License-Identifier: Apache-2.0
"""What errors a scanner makes: as large as its data sheet says, of the distribution it says."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from services.sensors.noise.random_streams import RandomStreams
from services.sensors.scanning.draws import RevolutionDraws
from tests.services.sensors.lidar import rooms

from . import targets

LASERS: dict[str, Any] = {"elevations_deg": [-2.0, -1.0, 0.0, 1.0, 2.0]}


def chi_square_holds(standardised: np.ndarray) -> None:
    """Hold numbers to a standard normal distribution: at five sigma of the sum's own spread."""
    count = standardised.size
    assert abs(np.sum(standardised**2) - count) < 5 * np.sqrt(2 * count)
    assert abs(standardised.mean()) < 5 / np.sqrt(count)
    assert stats.kstest(standardised.ravel(), "norm").pvalue > 1e-3


def errors(**spec: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and true ranges on a flat wall 20 m ahead, shape (lasers, firings)."""
    seen = targets.returns(targets.wall("gray", 20.0), **{**LASERS, **spec})
    assert seen.returned.all()
    assert seen.true_range_m.min() == pytest.approx(20.0, abs=1e-4)
    return (seen.range_m - seen.true_range_m)[0].astype(np.float64), seen.true_range_m[0]


def test_numbers_are_those_of_numpy() -> None:
    streams = RandomStreams(7, "rover/lidar")
    for tick, count in ((0, 57_600), (40, 7), (2**40, 1_000_000)):
        drawn = RevolutionDraws(streams).normals("range", tick, (count,))
        expected = streams.at("range", tick).standard_normal(count, np.float32)
        np.testing.assert_array_equal(drawn, expected)
    assert np.abs(drawn).max() > 3.66  # beyond the lowest layer


def test_without_errors_ranges_are_exact() -> None:
    error, _ = errors()
    assert not error.any()


def test_constant_noise() -> None:
    error, _ = errors(range_stddev_m=0.02)
    chi_square_holds(error / 0.02)


@pytest.mark.parametrize("distance_m", [5.0, 80.0])
@pytest.mark.parametrize("constant_m", [0.0, 0.01])
def test_proportional_noise(distance_m: float, constant_m: float) -> None:
    wall = targets.wall("gray", distance_m)
    seen = targets.returns(wall, range_stddev_m=constant_m, range_stddev_share=0.002, **LASERS)
    sigma = np.hypot(constant_m, 0.002 * seen.true_range_m)
    chi_square_holds(((seen.range_m - seen.true_range_m) / sigma)[0])


def test_each_laser_has_its_own_noise() -> None:
    own = np.array([0.01, 0.02, 0.03, 0.04, 0.05])
    error, _ = errors(range_stddev_m=0.01, laser_stddevs_m=own.tolist())
    for of_laser, sigma in zip(error, np.hypot(0.01, own), strict=True):
        chi_square_holds(of_laser / sigma)
    late_first = [4.0, 3.0, 2.0, 1.0, 0.0]
    error, _ = errors(laser_stddevs_m=own.tolist(), laser_times_us=late_first)
    assert error.std(axis=1) == pytest.approx(own[::-1], rel=0.15)


@pytest.mark.parametrize(("across_deg", "upward_deg"), [(0.05, 0.0), (0.0, 0.08), (0.05, 0.08)])
def test_jitter_is_seen_where_the_wall_is_slanted(across_deg: float, upward_deg: float) -> None:
    """On the floor and a wall that is met at a slant, ranges err by what the angles do.

    The point is reported in the nominal direction, at the range that the true ray met.
    """
    height, distance = 2.0, 20.0
    side = targets.box("gray", (0, distance + 0.5, 0), (900, 1, 900), "side")
    floor = targets.box("gray", (0, 0, -height - 0.5), (900, 900, 1), "floor")
    jitter = {"azimuth_stddev_deg": across_deg, "elevation_stddev_deg": upward_deg}

    # R = d / (sin(azimuth) cos(elevation)): in the first quarter both count.
    for elevation_deg in (0.0, 60.0):
        high = targets.scenario(side, start_deg=40.0, elevations_deg=[elevation_deg], **jitter)
        seen, azimuth = targets.measured(high), targets.azimuths(high)
        elevation = np.radians(elevation_deg)
        nominal = distance / (np.sin(azimuth) * np.cos(elevation))
        sigma = nominal * np.hypot(
            np.radians(across_deg) / np.tan(azimuth), np.radians(upward_deg) * np.tan(elevation)
        )
        error = seen.range_m[0] - nominal
        if sigma.any():
            # Not quite linear in the angles.
            standardised = error / sigma
            assert np.std(standardised) == pytest.approx(1, rel=0.08)
            assert stats.kstest(standardised.ravel(), "norm").pvalue > 1e-3
        else:
            assert np.abs(error).max() < 1e-3

    down = targets.scenario(floor, elevations_deg=[-5.0], **jitter)
    seen = targets.measured(down)
    slope = height * np.cos(np.radians(5.0)) / np.sin(np.radians(5.0)) ** 2
    error = (seen.range_m[0] - height / np.sin(np.radians(5.0))) / slope
    if upward_deg:
        spread = np.radians(upward_deg)
        # The range is not linear in the angle: second order terms are a share of it.
        assert np.std(error) == pytest.approx(spread, rel=0.08)
        assert stats.kstest(error.ravel() / spread, "norm").pvalue > 1e-4
    else:
        assert np.abs(error).max() < 1e-4


def test_both_returns_of_a_beam_have_noise_of_their_own() -> None:
    post = targets.box("gray", (10.05, 0, 5), (0.1, 10, 10), "upper_half")
    beams = {"divergence_mrad": [3.0, 3.0], "rays_per_beam": 4, "returns": "dual"}
    seen = targets.returns(post, targets.wall("gray", 20.0), range_stddev_m=0.02, **beams)
    assert seen.returned.all()
    errors = (seen.range_m - seen.true_range_m)[:, 0]
    for error in errors:
        chi_square_holds(error / 0.02)
    assert abs(np.corrcoef(*errors)[0, 1]) < 5 / np.sqrt(errors[0].size)


def test_angles_without_jitter_are_exact() -> None:
    """The path of rays with a jitter of nearly nothing gives what the plain one does."""
    wall = targets.wall("gray", 20.0)
    plain = targets.returns(wall, **LASERS)
    trembling = targets.returns(wall, azimuth_stddev_deg=1e-12, **LASERS)
    np.testing.assert_allclose(trembling.range_m, plain.range_m, atol=5e-6)


def test_a_deskewed_scan_of_a_moving_sensor_is_flat_within_its_noise() -> None:
    way = rooms.driving(speed_mps=3.0, turn_radps=4.0)
    mount = {"xyz_m": [0.2, -0.1, 0.4], "rpy_deg": [3.0, -5.0, 40.0]}
    made = rooms.scenario(mount=mount, firings_per_revolution=1800, range_stddev_m=0.02)
    (cloud,) = rooms.clouds(made, way, 41)
    points, seconds = rooms.points(cloud), rooms.sim_seconds(cloud)
    in_world = rooms.in_world(way, seconds, points, mount)
    eyes = rooms.in_world(way, seconds, np.zeros_like(points), mount)
    off = np.abs(in_world - rooms.MIDDLE) - rooms.HALF
    wall = np.argmin(np.abs(off), axis=1)
    rows = np.arange(len(wall))
    cosine = np.abs(in_world - eyes)[rows, wall] / np.linalg.norm(in_world - eyes, axis=1)
    # Away from edges, where another wall is nearer than the noise.
    clear = (np.sort(np.abs(off), axis=1)[:, 1] > 0.2) & (cosine > 0.2)
    assert clear.sum() > 10_000
    chi_square_holds((off[rows, wall] / (0.02 * cosine))[clear])
    skewed = rooms.in_world(way, np.full_like(seconds, seconds.mean()), points, mount)
    assert np.median(np.min(np.abs(np.abs(skewed - rooms.MIDDLE) - rooms.HALF), axis=1)) > 0.05
