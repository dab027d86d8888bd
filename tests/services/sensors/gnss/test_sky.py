# SPDX-License-Identifier: Apache-2.0
"""Orbits, and the sky that they make over a world, against closed forms and published figures."""

import math
from typing import Any

import numpy as np
import pytest

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from services.sensors.gnss.dilution import geometry
from services.sensors.gnss.geodesy import SEMI_MINOR_AXIS_M, Geodetic, TangentPlane
from services.sensors.gnss.sky import EARTH_RATE_RADPS, MovingSky, Orbits
from services.sensors.gnss.spec import Gnss, Walker
from tests.services.sensors.gnss.test_model import enu_m, fixes, receiver
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.yards import resting

WALKERS = {walker.system: walker for walker in from_sheet(Gnss, "gnss_zed_f9p").constellations}

PERIODS_S = {"gps": 43_082, "glonass": 40_544, "galileo": 50_682, "beidou": 46_400}
"""Half a sidereal day; 11 h 15 min 44 s; 14 h 4 min 42 s; 12 h 53 min 20 s."""

SIDEREAL_DAY_S = 2 * math.pi / EARTH_RATE_RADPS


def inertial(orbits: Orbits, seconds: float) -> Any:
    """Return positions in axes that do not turn with the Earth, shape (3, satellites)."""
    angle = EARTH_RATE_RADPS * seconds
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]]) @ orbits.ecef_m(seconds)


@pytest.mark.parametrize("system", WALKERS)
def test_orbits_have_the_published_period_radius_and_inclination(system: str) -> None:
    walker = WALKERS[system]
    orbits = Orbits([walker])
    period = PERIODS_S[system]
    assert len(orbits.satellites) == walker.satellites
    start, after = inertial(orbits, 100.0), inertial(orbits, 100.0 + period)
    # 20 s along an orbit are less than 80 km.
    assert np.linalg.norm(after - start, axis=0).max() < 8e4
    half = inertial(orbits, 100.0 + period / 2)
    np.testing.assert_allclose(half, -start, atol=8e4)
    radius = walker.semi_major_axis_km * 1000
    np.testing.assert_allclose(np.linalg.norm(start, axis=0), radius, rtol=1e-12)
    highest = max(np.abs(orbits.ecef_m(t)[2]).max() for t in range(0, period, 300))
    assert highest == pytest.approx(
        radius * math.sin(math.radians(walker.inclination_deg)), rel=1e-3
    )


def test_gps_is_over_the_same_places_after_a_sidereal_day() -> None:
    orbits = Orbits([WALKERS["gps"]])
    apart = orbits.ecef_m(500.0 + SIDEREAL_DAY_S) - orbits.ecef_m(500.0)
    assert np.linalg.norm(apart, axis=0).max() < 1e5


def test_a_pattern_is_even_and_shifted_from_plane_to_plane() -> None:
    """A Walker pattern maps onto itself if it is turned by a plane and moved by its phase."""
    walker = Walker("galileo", 6, 3, 1, 56.0, 29600.0)
    radius, node, argument, inclination = 29600e3, *np.radians([120.0, 60.0, 56.0]).tolist()
    (x, y, z) = Orbits([walker]).ecef_m(0.0)[:, 2]  # the first of the second plane
    expected = radius * np.array([
        math.cos(argument) * math.cos(node)
        - math.sin(argument) * math.cos(inclination) * math.sin(node),
        math.cos(argument) * math.sin(node)
        + math.sin(argument) * math.cos(inclination) * math.cos(node),
        math.sin(argument) * math.sin(inclination),
    ])  # fmt: skip
    np.testing.assert_allclose((x, y, z), expected, rtol=1e-12)
    np.testing.assert_allclose(Orbits([walker]).ecef_m(0.0)[:, 1], (-radius, 0, 0), atol=1e-6)


@pytest.mark.parametrize("system", ["gps", "glonass"])
def test_over_a_pole_satellites_rise_as_high_as_their_inclination_allows(system: str) -> None:
    """tan(elevation) = (cos(psi) - R / a) / sin(psi), with psi = 90 degrees - inclination."""
    walker = WALKERS[system]
    pole = TangentPlane(Geodetic.of_degrees(90.0, 0.0, 0.0))
    spec = Gnss("gnss", "/fix", "gnss_link", constellations=(walker,))
    sky = MovingSky(spec, pole)
    highest = max(
        math.asin(sky.towards(t * NANOS, np.zeros(3))[2].max()) for t in range(0, 6 * 3600, 120)
    )
    psi = math.radians(90.0 - walker.inclination_deg)
    ratio = SEMI_MINOR_AXIS_M / (walker.semi_major_axis_km * 1000)
    assert math.degrees(highest) == pytest.approx(
        math.degrees(math.atan2(math.cos(psi) - ratio, math.sin(psi))), abs=0.1
    )


def test_four_systems_are_more_accurate_than_one_and_satellites_pass() -> None:
    spec = from_sheet(Gnss, "gnss_zed_f9p")
    plane = TangentPlane(Geodetic.of_degrees(52.25, 20.9, 140.0))
    one = MovingSky(Gnss("gnss", "/fix", "gnss_link", constellations=(WALKERS["gps"],)), plane)
    four = MovingSky(spec, plane)
    for few, many in zip(one.typical_dilution_enu, four.typical_dilution_enu, strict=True):
        assert few > 1.3 * many
    # Of 24 GPS satellites 6 to 12 are above the horizon at a time, and not always the same.
    above = [one.towards(t * NANOS, np.zeros(3))[2] > 0 for t in range(0, 86400, 1800)]
    counts = [np.count_nonzero(now) for now in above]
    assert 6 <= min(counts) < max(counts) <= 12
    assert np.logical_or.reduce(above).all()
    # Neighbors in time differ by less than the motion of a satellite over the sky: 0.6 degrees/min.
    now, later = (one.towards(t * NANOS, np.zeros(3)) for t in (0, 60))
    turned = np.degrees(np.arccos(np.clip((now * later).sum(axis=0), -1, 1)))
    assert 0.1 < turned.min() < turned.max() < 0.7


def test_estimator_moves_the_position_away_from_a_satellite_that_seems_farther() -> None:
    towards = np.array([[1.0, -1, 0, 0, 0], [0, 0, 1.0, -1, 0], [0, 0, 0, 0, 1]])
    found = geometry(towards, np.ones(5, np.bool_))
    assert found is not None
    # East and west measure 2 m and -2 m too much: 2 m to the west, by neither clock nor height.
    moved = found.estimator @ np.array([2.0, -2.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(moved, (-2.0, 0.0, 0.0, 0.0), atol=1e-12)
    # All measure too much: only the clock.
    np.testing.assert_allclose(found.estimator @ np.full(5, 3.0), (0, 0, 0, 3.0), atol=1e-12)
    assert found.time_dilution == pytest.approx(0.5)


def test_errors_follow_the_dilution_of_the_moving_sky() -> None:
    """The covariance is that of the sheet times the dilution now over that of a day."""
    spec = from_sheet(Gnss, "gnss_zed_f9p", sky_view=False, multipath=None, startup_s=0.0)
    fields: dict[str, Any] = {
        **{"constellations": spec.constellations, "elevation_mask_deg": 10.0},
        "horizontal": spec.solutions[0].horizontal,
    }
    variances, dilutions, satellites = [], [], []
    for sky_time_s in (0.0, 7200.0):
        model = receiver(sky_time_s=sky_time_s, **fields)
        (fix,) = fixes(model, resting(1))
        assert fix.service == 1 + 2 + 4 + 8
        found = model.details(fix).solved
        assert found is not None
        variances.append(np.frombuffer(fix.position_covariance_m2)[0])
        dilutions.append(found.geometry.dilution_enu[0])
        satellites.append(found.used.tolist())
        sentence = model.datagrams(fix, 0)[0].payload
        assert sentence.startswith(b"$GNGGA")
        assert int(sentence.split(b",")[7]) == sum(satellites[-1])
        assert np.linalg.norm(enu_m([fix])[0]) < 20
    assert satellites[0] != satellites[1]
    assert variances[0] / variances[1] == pytest.approx((dilutions[0] / dilutions[1]) ** 2)


def test_an_elevation_mask_removes_low_satellites() -> None:
    (low,) = fixes(model := receiver(elevation_mask_deg=20.0), resting(1))
    assert model.datagrams(low, 0)[0].payload.split(b",")[7] == b"08"


def test_a_sky_without_positions_is_refused() -> None:
    with pytest.raises(UserError, match="no position at any time of a day"):
        receiver(constellations=(Walker("gps", 4, 1, 0, 55.0, 26560.0),), elevation_mask_deg=45.0)
