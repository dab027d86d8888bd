# SPDX-License-Identifier: Apache-2.0
"""Where light comes from, and that the view of each shadow map holds what it must."""

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scene.build import solids
from groundlink.world.bounds import bounds
from groundlink.world.weather import Lamps, Sun, Weather
from services.sensors.rendering.look.lights import lighting


def test_a_room_has_a_lamp_and_a_yard_the_sun() -> None:
    for name, is_sun in (("indoor_lab", False), ("yard", True)):
        scenario = load(SHIPPED / f"{name}.yaml")
        light = lighting(scenario.world, solids(scenario))
        assert light.is_sun is is_sun
        assert len(light.lights) == 1
        assert light.extinction_per_m == 0


def test_the_sun_stands_where_it_is_told_and_sees_the_whole_world() -> None:
    scenario = load(SHIPPED / "yard.yaml")
    static = solids(scenario)
    world = replace(scenario.world, light=Sun(azimuth_deg=90.0, elevation_deg=30.0))
    (sun,) = lighting(world, static).lights
    assert sun.at == pytest.approx((np.cos(np.radians(30)), 0.0, 0.5, 0.0), abs=1e-9)
    corners = np.array([[*corner, 1.0] for solid in static for corner in bounds(solid)])
    clip = corners @ sun.clip_from_world.T
    assert np.abs(clip[:, :3]).max() < 1
    # What is nearer to the sun has the smaller depth.
    low, high = (sun.clip_from_world @ (*(np.array(sun.at[:3]) * d), 1.0) for d in (1.0, 5.0))
    assert high[2] < low[2]
    assert high[:2] == pytest.approx(low[:2])


def test_a_lamp_sees_the_floor_below_it() -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    world = replace(scenario.world, light=Lamps(at_m=((1.0, 2.0, 2.9), (0.0, 0.0, 2.9))))
    first, second = lighting(world, solids(scenario)).lights
    assert first.at == (1.0, 2.0, 2.9, 1.0)
    x, y, z, w = first.clip_from_world @ (1.0, 2.0, 0.0, 1.0)
    assert (x, y) == pytest.approx((0, 0), abs=1e-9)
    assert w == pytest.approx(2.9)
    assert -1 < z / w < 1
    floor = second.clip_from_world @ (5.9, -3.9, 0.0, 1.0)
    assert np.abs(floor[:3] / floor[3]).max() < 1


def test_an_empty_world_is_lit() -> None:
    scenario = load(SHIPPED / "yard.yaml")
    assert np.isfinite(lighting(scenario.world, ()).lights[0].clip_from_world).all()


def test_fog_is_as_thick_as_the_visibility_says() -> None:
    scenario = load(SHIPPED / "yard.yaml")
    light = lighting(
        replace(scenario.world, weather=Weather(fog_visibility_m=100.0)), solids(scenario)
    )
    assert np.exp(-light.extinction_per_m * 100) == pytest.approx(0.05, abs=1e-4)
