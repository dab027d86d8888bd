# SPDX-License-Identifier: Apache-2.0
"""Fog, dust and rain: what they take away, and what they send back themselves."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import integrate, optimize, stats

from groundlink.world.weather import Dust, Weather
from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.returns import Returns
from services.sensors.scanning.weather import Atmosphere
from tests.services.sensors.lidar import rooms

from . import targets

AXIS: dict[str, Any] = {"field_of_view_deg": 0.001, "start_deg": 0.0}
SHEET: dict[str, Any] = {
    "full_range_reflectivity": 0.1,
    "max_range_m": 100.0,
    "pulse_length_ns": 6.0,
}
LEAST = 0.1 / 100**2
CELL_M = 299_792_458 * 6e-9 / 2
FOG = Weather(fog_visibility_m=60.0)
FOG_PER_M = math.log(20) / 60
SOFT = math.pi * 0.046 / 60 * CELL_M
"""Reflectance of a surface that is as bright as the fog that a pulse enters."""


def reach_m(reflectivity: float, extinction_per_m: float, least: float = LEAST) -> float:
    """Return where rho exp(-2 a R) / R^2 falls to what is just noticed."""

    def excess(r: float) -> float:
        return math.log(reflectivity / r**2 / least) - 2 * extinction_per_m * r

    return float(optimize.brentq(excess, 0.1, 1000.0))


def along_x(material: str, distance_m: float, weather: Weather, **spec: Any) -> Returns:
    wall = targets.wall(material, distance_m)
    return targets.returns(wall, weather=weather, **{**AXIS, **SHEET, **spec})


def label(seen: Returns) -> int | None:
    """Return what the first return of the one beam is of, None if there is no return."""
    return int(seen.label.flat[0]) if seen.returned.flat[0] else None


@pytest.mark.parametrize(("material", "rho"), [("white", 1.0), ("gray", 0.5), ("dark", 0.1)])
@pytest.mark.parametrize(
    ("weather", "extinction_per_m"),
    [
        (FOG, FOG_PER_M),
        (Weather(rain_mm_per_h=50.0), 0.01 * 50**0.6),
        (Weather(fog_visibility_m=300.0, rain_mm_per_h=10.0), math.log(20) / 300 + 0.01 * 10**0.6),
    ],
)
@pytest.mark.parametrize("wide", [{}, {"divergence_mrad": [0.1, 0.1], "rays_per_beam": 4}])
def test_visibility_follows_beer_lambert(
    material: str, rho: float, weather: Weather, extinction_per_m: float, wide: dict[str, Any]
) -> None:
    reach = reach_m(rho, extinction_per_m)
    assert 15 < reach < 80
    last = {"returns": "last", **wide}
    assert label(along_x(material, reach - 0.05, weather, **last)) == 1
    assert label(along_x(material, reach + 0.05, weather, **last)) != 1


def test_intensity_is_attenuated() -> None:
    for distance in (5.0, 12.0):
        seen = along_x("white", distance, FOG, returns="last")
        assert seen.intensity.item() == round(100 * math.exp(-2 * FOG_PER_M * distance))


@pytest.mark.parametrize(("min_range_m", "first_m"), [(0.5, 1.0), (2.0, 2.0)])
def test_fog_hides_weaker_returns(min_range_m: float, first_m: float) -> None:
    """The fog's own echo is the stronger one from where rho exp(-2 a R) / R^2 is below its."""
    least = SOFT * math.exp(-2 * FOG_PER_M * first_m) / first_m**2
    crossing = reach_m(0.5, FOG_PER_M, least)
    assert 3 < crossing < 30
    sheet = {"min_range_m": min_range_m}
    assert label(along_x("gray", crossing - 0.05, FOG, **sheet)) == 1
    assert label(along_x("gray", crossing + 0.05, FOG, **sheet)) == -1
    both = along_x("gray", crossing + 0.05, FOG, returns="dual", **sheet)
    assert both.returned.all()
    assert both.label.ravel().tolist() == [1, -1]


def test_the_echo_of_fog_lies_in_the_first_half_pulse() -> None:
    seen = targets.returns(weather=FOG, elevations_deg=[-2.0, 0.0, 2.0], **SHEET)
    assert seen.returned.all()
    assert set(seen.label.ravel()) == set(seen.body.ravel()) == {-1}
    deep = (seen.range_m.ravel() - 1.0) / CELL_M
    assert stats.kstest(deep, "uniform").pvalue > 1e-3
    near = along_x("gray", 1.3, FOG, field_of_view_deg=5.0, start_deg=2.5, returns="dual")
    assert (near.label[0] == 1).all()
    behind = near.range_m[1][near.returned[1]]
    assert 0.2 < len(behind) / near.label[1].size < 0.5  # a third of the half pulse is before it
    assert behind.max() < 1.31


@pytest.mark.parametrize("side", [-1, 1])
def test_fog_behind_a_partial_hit_returns_nothing(side: int) -> None:
    post = targets.box("gray", (1.25, side * 5.0, 0), (0.1, 10, 10), "half")
    beams = {"divergence_mrad": [9.0, 9.0], "rays_per_beam": 4, "returns": "dual", **AXIS}
    spec = {**SHEET, **beams, "elevations_deg": np.linspace(-1, 1, 99).tolist()}
    seen = targets.returns(post, weather=FOG, **spec)
    assert (seen.label == 1).any(axis=0).all()
    fog = seen.range_m[seen.returned & (seen.label == -1)]
    assert 5 < len(fog) < 60
    assert fog.max() < 1.21


def dust(visibility_m: float, *, from_m: float, to_m: float, y_m: float = 0.0) -> Weather:
    center = ((from_m + to_m) / 2, y_m, 0.0)
    cloud = Dust(center_m=center, size_m=(to_m - from_m, 4.0, 4.0), visibility_m=visibility_m)
    return Weather(dust=(cloud,))


def test_dust_weakens_by_the_way_through_it() -> None:
    for seen_through, way_m in (
        (dust(60.0, from_m=4, to_m=9), 5.0),
        (dust(60.0, from_m=4, to_m=30), 8.0),  # the wall is in it
        (dust(60.0, from_m=-4, to_m=6), 6.0),  # the sensor is
        (dust(60.0, from_m=4, to_m=9, y_m=2.5), 0.0),
        (dust(60.0, from_m=13, to_m=20), 0.0),
        (dust(60.0, from_m=-9, to_m=-4), 0.0),
    ):
        seen = along_x("white", 12.0, seen_through, returns="last")
        assert seen.intensity.item() == round(100 * math.exp(-2 * FOG_PER_M * way_m))


def test_dust_is_seen_where_a_ray_enters_it() -> None:
    cloud = dust(5.0, from_m=10, to_m=20)
    seen = along_x("gray", 30.0, cloud, field_of_view_deg=5.0, start_deg=2.5)
    assert seen.returned.all()
    assert set(seen.label.ravel()) == {-1}
    deep = (seen.range_m.ravel() - 10) / CELL_M
    assert deep.min() >= 0
    assert deep.max() <= 1.01  # slanted
    assert stats.kstest(deep, "uniform").pvalue > 1e-3
    # Too thin to be seen itself.
    assert label(along_x("gray", 30.0, dust(500.0, from_m=10, to_m=20))) == 1
    # Around the sensor it is seen where its echoes begin.
    within = targets.returns(weather=dust(5.0, from_m=-2, to_m=2), **SHEET)
    assert 1.0 <= within.range_m.min() < within.range_m.max() <= 1.01 + CELL_M


def test_dust_hides_weaker_returns() -> None:
    """A thin layer at 10 m, and a dark wall at 12 m: 0.1 / 12^2 and less light, or the dust's."""

    def margin(visibility_m: float) -> float:
        behind = 0.1 / 12**2 * math.exp(-2 * math.log(20) / visibility_m)
        return math.log(behind / (math.pi * 0.046 / visibility_m * CELL_M / 10**2))

    equal_m = float(optimize.brentq(margin, 0.5, 20.0))
    for visibility_m, expected in ((0.99 * equal_m, -1), (1.01 * equal_m, 1)):
        layer = dust(visibility_m, from_m=10, to_m=11)
        assert label(along_x("dark", 12.0, layer)) == expected


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_two_clouds_the_brighter_one_is_second(order: tuple[int, int]) -> None:
    clouds = dust(20.0, from_m=5, to_m=5.5).dust + dust(10.0, from_m=8, to_m=8.5).dust
    both = Weather(dust=tuple(clouds[i] for i in order))
    seen = along_x("sign", 12.0, both, returns="dual", pulse_length_ns=1.0)
    assert seen.returned.all()
    assert seen.range_m[:, 0, 0] == pytest.approx([12.0, 5.1], abs=0.2)


WET: dict[str, Any] = {
    **{"full_range_reflectivity": 0.02, "max_range_m": 100.0, "pulse_length_ns": 6.0},
    **{"divergence_mrad": [3.0, 1.5], "elevations_deg": np.linspace(-3, 3, 13).tolist()},
}


def drops_up_to(range_m: float, rain_mm_per_h: float) -> float:
    """Return how many noticeable drops a beam of `WET` meets from 1 m on, by the formulas."""
    slope_per_mm = 4.1 * rain_mm_per_h**-0.21
    extinction_per_m = 0.01 * rain_mm_per_h**0.6

    def density(r: float) -> float:
        area = (0.01 + 3e-3 * r) * (0.01 + 1.5e-3 * r)
        # rho d^2 pi / 4 / area exp(-2 a r) / r^2 is at least what is noticed.
        filled = 0.02 / 100**2 * r**2 * math.exp(2 * extinction_per_m * r) / 0.005
        least_mm = 1000 * math.sqrt(4 * area * filled / math.pi)
        return area * 8000 / slope_per_mm * math.exp(-slope_per_mm * least_mm)

    return float(integrate.quad(density, 1.0, range_m)[0])


def test_the_number_of_drops_is_the_formulas_integral() -> None:
    spec = targets.scenario(**WET).vehicles[0].sensors[0]
    assert isinstance(spec, Lidar)
    found = Atmosphere(spec, Weather(rain_mm_per_h=20.0))
    for range_m, drops in list(zip(found.drop_ranges_m, found.drops, strict=True))[1::40]:
        assert drops == pytest.approx(drops_up_to(float(range_m), 20.0), rel=1e-3)


@pytest.mark.parametrize("rain_mm_per_h", [5.0, 50.0])
def test_false_returns_of_rain_are_poissons(rain_mm_per_h: float) -> None:
    seen = targets.returns(weather=Weather(rain_mm_per_h=rain_mm_per_h), **WET)
    expected = drops_up_to(100.0, rain_mm_per_h)
    share = 1 - math.exp(-expected)
    count, beams = np.count_nonzero(seen.returned), seen.returned.size
    assert beams == 13 * 1001
    assert abs(count - share * beams) < 4 * math.sqrt(beams * share * (1 - share))
    assert 0.1 < share < 0.9
    # Where the first drop is met.
    ranges = seen.range_m[seen.returned].astype(np.float64)
    grid = np.linspace(1, 20, 200)
    cumulated = np.array([1 - math.exp(-drops_up_to(r, rain_mm_per_h)) for r in grid]) / share
    assert stats.kstest(ranges, lambda r: np.interp(r, grid, cumulated)).pvalue > 1e-3
    assert set(seen.label[seen.returned]) == {-1}
    # Neighbors know nothing of each other.
    fell = seen.returned[0].astype(float)
    assert abs(np.corrcoef(fell[:, 1:].ravel(), fell[:, :-1].ravel())[0, 1]) < 5 / math.sqrt(beams)


def test_drops_are_dim_and_hide_no_near_wall() -> None:
    rain = Weather(rain_mm_per_h=50.0)
    bare = targets.returns(weather=rain, **WET)
    # The brightest drop seen at 1 m is as bright as a surface of a few percent there.
    assert bare.intensity[bare.returned].max() <= 2
    near = targets.returns(targets.wall("gray", 4.0), weather=rain, **WET)
    assert (near.label == 1).mean() > 0.999
    both = targets.returns(targets.wall("gray", 4.0), weather=rain, **WET, returns="dual")
    share = 1 - math.exp(-drops_up_to(4.0, 50.0))
    fell = np.count_nonzero(both.returned[1])
    count = both.returned[1].size
    assert abs(fell - share * count) < 5 * math.sqrt(count * share)
    assert (both.label[0] == 1).all()


def test_rain_is_new_in_each_revolution_and_the_same_in_each_run() -> None:
    def fallen(seed: int) -> list[bytes]:
        made = targets.scenario(weather=Weather(rain_mm_per_h=20.0), seed=seed, **WET)
        sensor = targets.scanner(made)
        return [
            scan.returns.returned.tobytes()
            for state in rooms.states(made, targets.at_rest, 81)
            for scan in sensor.take(state)
        ]

    assert fallen(1) == fallen(1)
    assert len({*fallen(1), *fallen(2)}) == 4


def test_blocks_hold_the_very_numbers_of_the_revolution() -> None:
    weather = Weather(
        fog_visibility_m=40.0,
        rain_mm_per_h=30.0,
        dust=(Dust(center_m=(8, 0, 0), size_m=(2, 9, 9), visibility_m=20.0),),
    )

    def seen(**spec: Any) -> list[Returns]:
        made = targets.scenario(
            targets.wall("gray", 12.0), weather=weather, returns="dual", **{**WET, **spec}
        )
        sensor = targets.scanner(made)
        fed = rooms.states(made, targets.at_rest, 41)
        return [scan.returns for state in fed for scan in sensor.take(state)]

    (whole,), blocks = seen(), seen(block_deg=1.0)
    assert len(blocks) == 10
    for field in set(Returns._fields) - {"ray"}:  # its numbers are of a cast
        together = np.concatenate([getattr(block, field) for block in blocks], axis=-1)
        np.testing.assert_array_equal(together, getattr(whole, field))


def test_weather_is_nothing_to_a_device_that_sees_everything() -> None:
    wall = targets.wall("dark", 50.0)
    clear = targets.returns(wall, range_stddev_m=0.01)
    wet = targets.returns(wall, range_stddev_m=0.01, weather=Weather(fog_visibility_m=5.0))
    for one, other in zip(clear, wet, strict=True):
        np.testing.assert_array_equal(one, other)
