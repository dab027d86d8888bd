# SPDX-License-Identifier: Apache-2.0
"""The worlds that come with Groundlink: they build, stand on their ground, and leave ways free."""

from itertools import pairwise
from math import radians
from pathlib import Path

import numpy as np
import pytest

from groundlink.episode.routes import line
from groundlink.loader import load
from groundlink.loader.partial_scenario import FileKind, load_partial
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario import Scenario
from groundlink.scene.build import solids, world_hash
from groundlink.scene.spawn_pose import collision_solids
from groundlink.world.bounds import bounds
from groundlink.world.objects.outdoor_objects import build_outdoor_object
from groundlink.world.objects.outdoor_specs import Fence
from groundlink.world.terrain import Ground, load_ground

WORLDS = sorted(file.stem for file in (SHIPPED / "worlds").glob("*.yaml"))
DRIVEN = sorted(file for file in SHIPPED.glob("*.yaml") if "route:" in file.read_text("utf-8"))

ROLLED_OVER_M = 0.15
"""What is no higher above the ground is no obstacle."""

BESIDE_M = 0.1
"""Kept free on both sides of a vehicle that follows its route."""


@pytest.fixture(scope="module")
def hamlet() -> Scenario:
    return load("outdoor_paper")


def ground_of(scenario: Scenario) -> Ground | None:
    return load_ground(scenario.world.terrain) if scenario.world.terrain else None


@pytest.mark.parametrize("world", WORLDS)
def test_it_builds(world: str) -> None:
    kind, scenario = load_partial(world)
    assert kind is FileKind.WORLD
    assert scenario.world.name == world
    assert solids(scenario) or scenario.world.terrain
    assert world_hash(scenario) == world_hash(load_partial(world)[1])


def test_the_valley_is_as_large_as_the_papers_terrain() -> None:
    scenario = load_partial("valley")[1]
    here = ground_of(scenario)
    assert here
    assert here.heights.shape == (1501, 1501)
    assert here.cell_m == 10
    shares = np.bincount(here.surface.ravel(), minlength=7) / here.surface.size
    named = dict(zip(here.materials, shares.round(3), strict=False))
    assert {name for name, share in named.items() if share > 0.02} >= {
        "grass",
        "forest_floor",
        "heath",
        "scree",
        "rock",
        "snow",
    }, named


def test_nothing_floats_and_nothing_is_buried(hamlet: Scenario) -> None:
    here = ground_of(hamlet)
    assert here
    kinds = set()
    for index, thing in enumerate(hamlet.world.outdoors):
        kinds.add(type(thing).__name__)
        heights = here.height_at(*zip(*thing.feet(), strict=True))
        low, high = (
            np.array([bounds(solid)[i][2] for solid in build_outdoor_object(index, thing)])
            for i in (0, 1)
        )
        if isinstance(thing, Fence):
            np.testing.assert_allclose(thing.ground_m, heights, atol=0.01)
            continue
        assert thing.z_m == pytest.approx(heights.min(), abs=0.01)
        assert np.ptp(heights) < 0.4, thing
        assert low.min() < heights.min() + 0.01
        assert high.max() > heights.max() + 0.1, thing
    assert len(kinds) == 9


def test_the_hamlet_is_a_few_hundred_things_by_its_seed(hamlet: Scenario, tmp_path: Path) -> None:
    assert len(solids(hamlet)) < 1600
    text = (SHIPPED / "outdoor_paper.yaml").read_text(encoding="utf-8")
    hashes = []
    for seed in (1, 2):
        file = tmp_path / f"{seed}.yaml"
        file.write_text(text.replace("seed: 1\n", f"seed: {seed}\n"), encoding="utf-8")
        hashes.append(world_hash(load(file)))
    assert hashes[0] == world_hash(hamlet)
    assert hashes[1] != hashes[0]


@pytest.mark.parametrize("file", DRIVEN, ids=lambda file: file.stem)
def test_routes_keep_clear(file: Path) -> None:
    scenario = load(file)
    here, built = ground_of(scenario), solids(scenario)
    lows, highs = (np.array([bounds(solid)[i] for solid in built]) for i in (0, 1))
    for vehicle in scenario.vehicles:
        if vehicle.route is None:
            continue
        at = vehicle.placement
        turned = radians(at.yaw_deg)
        way = line(vehicle.route, start_m=(at.x_m, at.y_m), heading_rad=turned).points_m
        dense = np.concatenate(
            [np.linspace(a, b, max(2, int(np.hypot(*(b - a)) / 0.1))) for a, b in pairwise(way)]
        )
        ground_m = here.height_at(*dense.T) if here else np.zeros(len(dense))
        assert not np.isnan(ground_m).any()
        half_m = vehicle.model.chassis.size_m[1] / 2
        top_m = max(bounds(part)[1][2] for part in collision_solids(vehicle.model))
        top_m += vehicle.model.base_height_m
        for solid, low, high in zip(built, lows, highs, strict=True):
            beyond = np.maximum(low[:2] - dense, dense - high[:2]).clip(0)
            near = np.hypot(*beyond.T) < half_m + BESIDE_M
            there = (high[2] > ground_m + ROLLED_OVER_M) & (low[2] < ground_m + top_m)
            assert not (near & there).any(), (solid.name, dense[near & there][0])


HASHES = {
    "indoor_2d": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_depth": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_lab": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_lab_tour": "b1075bbdb48d4aac45df7156aabf281e908532132d2c8cf6daf8b52d312f515e",
    "indoor_paper": "60a9e84690f44261ec0211c42424049fef7bebb4cc041ab16e430746c45e59a8",
    "outdoor_paper": "2ec40249e6e9a06550968d502f26d024e1255623b999f54cced7d232b9a6d465",
    "scanned_room": "d26cf4b6a0c940f261f9da7c42093b037433b4cfcbe9d52bc535f38310e6e53b",
    "track": "eefa5a49168a514911b79c7ce4125ca3caae17d5df0a5c2667cc68eb15aeb7b7",
    "two_rovers": "19a61f6474fb1a19f4f6a48c763d7761553db65a8e546b35ae82a2b81182f4ba",
    "yard": "beb2269f674e360714411a23890a2026772d077c142af0f019bced5d08adbb87",
}


@pytest.mark.parametrize("name", HASHES)
def test_the_world_is_the_same_to_the_bit(name: str) -> None:
    assert world_hash(load(name)) == HASHES[name]
