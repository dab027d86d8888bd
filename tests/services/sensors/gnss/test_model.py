# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy import stats

from groundlink.core.errors import UserError
from groundlink.messages.base import BadBusMessage, State, floats
from groundlink.messages.navigation import NavSatFix
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from services.sensors.gnss.geodesy import Geodetic, TangentPlane, ecef_from_geodetic
from services.sensors.gnss.model import GnssErrors, GnssModel
from services.sensors.gnss.reception import inside
from services.sensors.gnss.spec import Gnss, PositionNoise
from services.sensors.noise.random_streams import RandomStreams
from tests.services.sensors.states import EPOCH_NANOS, scenario
from tests.services.sensors.yards import DATUM, box, moving, resting, yard

NOISY: dict[str, Any] = {
    "horizontal": PositionNoise(0.5, 1.0),
    "vertical": PositionNoise(1.0, 2.0),
    "drift_time_s": 5.0,
    "velocity_stddev_mps": 0.05,
}

PLANE = TangentPlane(Geodetic.of_degrees(DATUM.latitude_deg, DATUM.longitude_deg, DATUM.altitude_m))


def receiver(made: Scenario | None = None, **fields: Any) -> GnssModel:
    run = made or yard()
    spec = Gnss(name="gnss", topic="/fix", frame="gnss_link", **fields)
    return GnssModel(run, run.vehicles[0], spec)


def fixes(model: GnssModel, run: Iterable[State]) -> list[NavSatFix]:
    return [fix for state in run for fix in model.readings(state)]


def ecef_m(fix: NavSatFix) -> NDArray[np.float64]:
    place = Geodetic.of_degrees(fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
    return np.array(ecef_from_geodetic(place))


def enu_m(taken: Iterable[NavSatFix]) -> NDArray[np.float64]:
    """Return where fixes are in the world, shape (fixes, 3)."""
    units = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    axes = np.array([PLANE.turned(unit) for unit in units])
    origin = np.array(PLANE.ecef((0.0, 0.0, 0.0)))
    return np.array([axes @ (ecef_m(fix) - origin) for fix in taken])


def test_an_ideal_receiver_is_exact_and_sits_at_its_antenna() -> None:
    rng = np.random.default_rng(1)
    places = np.cumsum(rng.normal(scale=0.1, size=(400, 3)), axis=0)
    places += np.array((900.0, -700.0, 3.0))
    half = math.sqrt(0.5)  # Turned left by 90 degrees: forward is north.
    model = receiver(mount=Mount((0.3, 0.1, 0.9)), rate_hz=20)
    taken = fixes(model, moving(places, (0.0, 0.0, half, half)))
    assert [fix.stamp_nanos - EPOCH_NANOS for fix in taken] == [i * 50_000_000 for i in range(20)]
    np.testing.assert_allclose(enu_m(taken), places[::20] + np.array((-0.1, 0.3, 0.9)), atol=1e-8)
    for fix in taken:
        assert (fix.status, fix.service, fix.covariance_type) == (0, 1, 2)
        assert not floats(fix.position_covariance_m2).any()


@pytest.mark.parametrize("rate_hz", [3, 7.5, 19.97])
def test_between_two_ticks_the_place_is_that_of_the_stamp(rate_hz: float) -> None:
    speed = 15.0
    ticks = np.arange(800)
    places = np.stack([speed * ticks / 400, 0 * ticks, 0 * ticks], axis=1)
    taken = fixes(receiver(rate_hz=rate_hz), moving(places))
    assert len(taken) == math.floor(799 / 400 * rate_hz) + 1
    seconds = np.array([fix.stamp_nanos - EPOCH_NANOS for fix in taken]) * 1e-9
    np.testing.assert_allclose(enu_m(taken)[:, 0], speed * seconds, atol=2e-8)


def test_a_fix_comes_late_with_the_stamp_of_its_instant() -> None:
    places = np.stack([np.arange(400) / 400, np.zeros(400), np.zeros(400)], axis=1)
    model = receiver(rate_hz=10, latency_s=0.1)
    came = {}
    for state in moving(places):
        for fix in model.readings(state):
            came[state.tick] = fix
    assert list(came) == list(range(40, 400, 40))
    for tick, fix in came.items():
        assert fix.stamp_nanos - EPOCH_NANOS == (tick - 40) * 2_500_000
        assert enu_m([fix])[0, 0] == pytest.approx((tick - 40) / 400, abs=1e-8)


@pytest.mark.parametrize(
    ("solution", "status", "quality"),
    [("single_point", 0, "1"), ("sbas", 1, "2"), ("rtk_float", 2, "5"), ("rtk_fix", 2, "4")],
)
def test_kind_of_solution_is_in_both_messages(solution: str, status: int, quality: str) -> None:
    model = receiver(solution=solution)
    (fix,) = fixes(model, resting(1))
    assert fix.status == status
    gga, rmc, vtg = (line.payload.decode().split(",") for line in model.datagrams(fix, 0))
    assert gga[6] == quality
    assert rmc[12][0] == vtg[9][0] == {"1": "A", "2": "D", "5": "F", "4": "R"}[quality]
    assert gga[7] == "10"
    assert float(gga[9]) == pytest.approx(140.0 - 31.0)
    assert float(gga[11]) == 31.0


def test_sentences_follow_faults_of_a_fix() -> None:
    model = receiver(rate_hz=20)
    first, *_ = fixes(model, resting(41))
    moved = replace(first, latitude_deg=first.latitude_deg + 0.5, stamp_nanos=7 * 10**9)
    gga, _, vtg = (line.payload.decode().split(",") for line in model.datagrams(moved, 0))
    assert gga[1:3] == ["000007.00", "5245.00000"]
    assert (gga[6], vtg[9][0]) == ("1", "A")
    gga, rmc, _ = (
        line.payload.decode().split(",") for line in model.datagrams(replace(first, status=-1), 0)
    )
    assert (gga[2], gga[6], rmc[2]) == ("", "0", "V")


def test_velocity_in_the_sentences_is_the_antennas() -> None:
    # 2 m/s north and a turn of 1 rad/s with the antenna 0.5 m ahead (east): 0.5 m/s more north.
    model = receiver(mount=Mount((0.5, 0.0, 0.0)))
    (fix,) = fixes(model, resting(1, velocities=(1.0, 2.0, 0.0, 0.0, 0.0, 1.0)))
    fields = model.datagrams(fix, 0)[2].payload.decode().split(",")
    assert float(fields[7]) == pytest.approx(3.6 * math.hypot(1.0, 2.5), abs=1e-3)
    assert float(fields[1]) == pytest.approx(math.degrees(math.atan2(1.0, 2.5)), abs=0.01)


def test_white_errors_match_the_covariance() -> None:
    spec: dict[str, Any] = {
        "horizontal": PositionNoise(0.5),
        "vertical": PositionNoise(1.0),
        "rate_hz": 20,
    }
    taken = fixes(receiver(**spec), resting(20 * 2000))
    off = enu_m(taken)
    assert len(off) == 2000
    for axis, sigma in enumerate((0.5, 0.5, 1.0)):
        assert stats.kstest(off[:, axis] / sigma, "norm").pvalue > 0.001
        chi = float(np.sum(off[:, axis] ** 2)) / sigma**2
        assert 0.0005 < stats.chi2.cdf(chi, len(off)) < 0.9995
    assert np.abs(np.corrcoef(off.T) - np.eye(3)).max() < 0.1
    covariance = floats(taken[0].position_covariance_m2).reshape(3, 3)
    np.testing.assert_allclose(covariance, np.diag([0.25, 0.25, 1.0]))


def test_equal_errors_are_the_papers_normal_error_along_the_earths_axes() -> None:
    spec: dict[str, Any] = {
        "horizontal": PositionNoise(1.0),
        "vertical": PositionNoise(1.0),
        "rate_hz": 20,
    }
    taken = fixes(receiver(**spec), resting(20 * 1500))
    off = np.array([ecef_m(fix) for fix in taken]) - np.array(PLANE.ecef((0.0, 0.0, 0.0)))
    for axis in off.T:
        assert stats.kstest(axis, "norm").pvalue > 0.001
    assert np.abs(np.corrcoef(off.T) - np.eye(3)).max() < 0.1


def test_drift_is_a_gauss_markov_process_of_its_time() -> None:
    spec = Gnss(
        *("gnss", "/fix", "gnss_link"),
        rate_hz=5,
        horizontal=PositionNoise(0.0, 1.0),
        drift_time_s=2.0,
    )
    errors = GnssErrors(spec, RandomStreams(1, "rover/gnss"))
    off = np.array([errors.of_fix(i).position_m for i in range(3000)])
    assert not off[:, 2].any()
    for axis in off.T[:2]:
        # 600 s are 300 times 2 s: the estimates scatter by some 6 %.
        assert axis.std() == pytest.approx(1.0, rel=0.2)
        for lag_s in (0.6, 1.0, 2.0):
            lag = round(5 * lag_s)
            found = np.mean(axis[lag:] * axis[:-lag]) / np.mean(axis**2)
            assert found == pytest.approx(math.exp(-lag_s / 2.0), abs=0.12)


def test_startup_and_outages_give_no_fix() -> None:
    square = ((1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0))
    model = receiver(rate_hz=10, startup_s=0.5, outages=(square,))
    ticks = np.arange(1201)
    places = np.stack([ticks / 400, 0 * ticks, 0 * ticks], axis=1)
    taken, lines = [], []
    for state in moving(places):
        for fix in model.readings(state):
            taken.append(fix)
            lines.append([line.payload.decode().split(",") for line in model.datagrams(fix, 0)])
    x = np.arange(31) / 10
    lost = (x < 0.5) | ((x > 1.0 - 1e-9) & (x < 2.0 - 1e-9))
    assert [fix.status < 0 for fix in taken] == lost.tolist()
    for fix, (gga, rmc, vtg) in zip(taken, lines, strict=True):
        if fix.status < 0:
            assert math.isnan(fix.latitude_deg)
            assert math.isnan(fix.longitude_deg)
            assert math.isnan(fix.altitude_m)
            assert (fix.status, fix.covariance_type) == (-1, 0)
            assert (gga[6], rmc[2], vtg[9][0]) == ("0", "V", "N")


@pytest.mark.parametrize(
    ("point", "expected"),
    [((1, 1), True), ((3, 1), False), ((3, 3.5), True), ((-1, 1), False), ((1, 5), False)],
)
def test_outages_may_have_any_shape(point: tuple[float, float], expected: bool) -> None:
    corner = [(0, 0), (2, 0), (2, 3), (4, 3), (4, 4), (0, 4)]
    assert inside(*point, corner) is expected
    assert inside(*point, corner[::-1]) is expected


UP = Mount((0.0, 0.0, 1.0))


def test_under_a_roof_there_is_no_fix_and_beside_a_wall_a_worse_one() -> None:
    roof = box("roof", (30, 30, 0.2), (0, 0, 4))
    wall = box("wall", (100, 0.2, 60), (0, 33, 0))  # Hides the north up to 40 degrees or so.
    made = yard(roof, wall)
    model = receiver(made, mount=UP, sky_view=True, **NOISY)
    away, near, below = (
        fixes(receiver(made, mount=UP, sky_view=True, **NOISY), resting(1, at))[0]
        for at in ((0, -900, 0), (30, 31.5, 0), (0, 0, 0))
    )
    assert below.status == -1
    assert (away.status, near.status) == (0, 0)
    open_sky = np.diag([1.25, 1.25, 5.0])
    np.testing.assert_allclose(floats(away.position_covariance_m2).reshape(3, 3), open_sky)
    worse = floats(near.position_covariance_m2).reshape(3, 3)
    assert (np.diag(worse) > 1.3 * np.diag(open_sky)).all()
    (fix,) = fixes(model, resting(1, (30, 31.5, 0)))
    gga = model.datagrams(fix, 0)[0].payload.decode().split(",")
    assert 4 <= int(gga[7]) < 10


def test_errors_beside_a_wall_match_the_covariance() -> None:
    made = yard(box("wall", (100, 0.2, 60), (0, 2, 0)))
    spec: dict[str, Any] = {
        "horizontal": PositionNoise(0.5),
        "vertical": PositionNoise(1.0),
        "rate_hz": 20,
    }
    taken = fixes(receiver(made, mount=UP, sky_view=True, **spec), resting(20 * 400))
    sigmas = np.sqrt(floats(taken[0].position_covariance_m2)[::4])
    assert sigmas[0] > 0.5
    for axis, (off, sigma) in enumerate(zip(enu_m(taken).T, sigmas, strict=True)):
        off = off - UP.xyz_m[axis]
        assert 0.0005 < stats.chi2.cdf(float(np.sum(off**2)) / sigma**2, len(off)) < 0.9995


def test_more_satellites_needed_than_seen_is_no_fix() -> None:
    made = yard(box("wall", (100, 0.2, 60), (0, 2, 0)))
    statuses = [
        fixes(receiver(made, mount=UP, sky_view=True, satellites_needed=n), resting(1))[0].status
        for n in (4, 10)
    ]
    assert statuses == [0, -1]


def test_satellites_in_one_place_are_refused() -> None:
    with pytest.raises(UserError, match="spread them over the sky"):
        receiver(satellites_deg=((0.0, 45.0),) * 5)


@pytest.mark.parametrize("sky_view", [False, True])
def test_a_state_without_the_vehicle_is_refused(sky_view: bool) -> None:
    (state,) = resting(1)
    model = receiver(sky_view=sky_view)
    with pytest.raises(BadBusMessage, match="tick 0: no link poses of `rover`"):
        model.readings(replace(state, vehicles={}))
    assert model.settled_tick() == -1
    assert len(model.readings(state)) == 1


def test_a_world_without_a_datum_is_refused() -> None:
    with pytest.raises(UserError, match="add `datum` to the world"):
        receiver(scenario())
