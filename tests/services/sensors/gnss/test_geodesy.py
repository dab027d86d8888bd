# SPDX-License-Identifier: Apache-2.0
"""WGS 84 against published points, against itself over the globe, and against pymap3d."""

import math

import numpy as np
import pytest

from services.sensors.gnss.geodesy import (
    SEMI_MAJOR_AXIS_M,
    SEMI_MINOR_AXIS_M,
    Geodetic,
    TangentPlane,
    ecef_from_geodetic,
    geodetic_from_ecef,
)

BEST_M = 1e-8
"""What a round trip may be off by."""

PLACES = [
    *((lat, lon, alt) for lat in (-90, -89.999999, -45, 0, 1e-9, 52.2, 89.9999999, 90)
      for lon in (-180, -90, 0, 20.9, 90, 180) for alt in (-11_000, 0, 110, 20_000)),
]  # fmt: skip


def over_the_globe(count: int = 20_000) -> np.ndarray:
    """Latitude, longitude (rad) and altitude, evenly over the sphere, shape (count, 3)."""
    draws = np.random.default_rng(3).random((count, 3))
    latitudes = np.arcsin(2 * draws[:, 0] - 1)
    return np.stack([latitudes, (2 * draws[:, 1] - 1) * np.pi, draws[:, 2] * 1e5 - 1e4], axis=1)


def meters_between(first: Geodetic, second: Geodetic) -> float:
    """Return the distance of two places that are near each other."""
    turn = math.remainder(first.longitude_rad - second.longitude_rad, 2 * math.pi)
    return math.hypot(
        SEMI_MAJOR_AXIS_M * (first.latitude_rad - second.latitude_rad),
        SEMI_MAJOR_AXIS_M * math.cos(first.latitude_rad) * turn,
        first.altitude_m - second.altitude_m,
    )


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "expected"),
    [
        (0.0, 0.0, (SEMI_MAJOR_AXIS_M, 0.0, 0.0)),
        (0.0, 90.0, (0.0, SEMI_MAJOR_AXIS_M, 0.0)),
        (90.0, 0.0, (0.0, 0.0, SEMI_MINOR_AXIS_M)),
        (-90.0, 77.0, (0.0, 0.0, -SEMI_MINOR_AXIS_M)),
    ],
)
def test_the_axes_meet_the_ellipsoid_where_they_should(
    latitude_deg: float, longitude_deg: float, expected: tuple[float, float, float]
) -> None:
    assert SEMI_MINOR_AXIS_M == pytest.approx(6356752.314245, abs=1e-6)  # NGA.STND.0036
    found = ecef_from_geodetic(Geodetic.of_degrees(latitude_deg, longitude_deg, 0.0))
    assert found == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("place", PLACES)
def test_there_and_back_at_poles_and_meridians(place: tuple[float, float, float]) -> None:
    start = Geodetic.of_degrees(*place)
    assert meters_between(start, geodetic_from_ecef(ecef_from_geodetic(start))) < BEST_M


def test_there_and_back_over_the_globe() -> None:
    worst = 0.0
    for row in over_the_globe().tolist():
        start = Geodetic(*row)
        back = geodetic_from_ecef(ecef_from_geodetic(start))
        worst = max(worst, meters_between(start, back))
    assert worst < BEST_M


def test_pymap3d_agrees() -> None:
    pymap3d = pytest.importorskip("pymap3d")
    places = over_the_globe()
    theirs = np.stack(pymap3d.geodetic2ecef(*places.T, deg=False), axis=1)
    ours = np.array([ecef_from_geodetic(Geodetic(*row)) for row in places.tolist()])
    assert np.abs(ours - theirs).max() < BEST_M
    # Its own inverse is off by up to 3e-7 m; its forward formula says where our inverse leads.
    back = np.array([geodetic_from_ecef(tuple(row)) for row in theirs.tolist()])
    again = np.stack(pymap3d.geodetic2ecef(*back.T, deg=False), axis=1)
    assert np.linalg.norm(again - theirs, axis=1).max() < BEST_M


def test_the_tangent_plane_is_pymap3ds() -> None:
    pymap3d = pytest.importorskip("pymap3d")
    origin = Geodetic.of_degrees(52.2, 20.9, 110.0)
    plane = TangentPlane(origin)
    for enu in np.random.default_rng(4).normal(scale=3000, size=(500, 3)).tolist():
        theirs = pymap3d.enu2ecef(*enu, *origin, deg=False)
        assert math.dist(plane.ecef(tuple(enu)), [float(v) for v in theirs]) < BEST_M


def test_the_tangent_plane_has_right_angles_and_points_up() -> None:
    origin = Geodetic.of_degrees(-33.0, 151.0, 20.0)
    plane = TangentPlane(origin)
    east, north, up = (plane.turned(axis) for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)))
    np.testing.assert_allclose(np.cross(east, north), up, atol=1e-15)
    assert east[2] == 0.0
    higher = geodetic_from_ecef(plane.ecef((0.0, 0.0, 50.0)))
    assert meters_between(higher, origin._replace(altitude_m=70.0)) < BEST_M
    assert geodetic_from_ecef(plane.ecef((0.0, 5.0, 0.0))).latitude_rad > origin.latitude_rad
