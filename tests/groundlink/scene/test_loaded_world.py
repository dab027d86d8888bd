# SPDX-License-Identifier: Apache-2.0
"""A run's vehicles in other worlds: starts, materials, what stays, and hashes of equal worlds."""

import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.loader.partial_scenario import load_partial
from groundlink.scenario import Scenario
from groundlink.scene.build import solids, world_hash
from groundlink.scene.loaded_world import (
    distinct,
    has_world,
    in_present_world,
    is_other_world,
    with_world,
    without_world,
)
from groundlink.world.actors import EntityDescription
from groundlink.world.weather import Weather


@pytest.fixture(scope="module")
def rovers() -> Scenario:
    return load("two_rovers")


@pytest.fixture(scope="module")
def yard() -> Scenario:
    return load("yard")


def test_vehicles_start_where_those_of_the_scenario_do_and_further_ones_at_their_own_starts(
    rovers: Scenario, yard: Scenario
) -> None:
    first, second = with_world(rovers, yard).vehicles
    assert first == replace(rovers.vehicles[0], placement=yard.vehicles[0].placement)
    assert second == rovers.vehicles[1]
    assert with_world(yard, rovers).vehicles[0].placement == rovers.vehicles[0].placement


def test_all_but_the_world_is_the_runs(rovers: Scenario, yard: Scenario) -> None:
    loaded = with_world(rovers, yard)
    assert loaded.description == yard.description
    kept = replace(
        loaded, description=rovers.description, vehicles=rovers.vehicles, world=rovers.world
    )
    assert kept == rovers
    assert solids(loaded) == solids(replace(yard, vehicles=rovers.vehicles, seed=rovers.seed))


def test_a_world_alone_gets_the_vehicles_materials_and_is_then_that_of_its_scenario() -> None:
    lab = load("indoor_lab")
    _, alone = load_partial("worlds/lab")
    assert with_world(lab, lab) == lab
    assert world_hash(with_world(lab, alone)) == world_hash(lab)


def test_descriptions_of_vehicles_that_are_not_there_are_left_out(yard: Scenario) -> None:
    lab = load("indoor_lab")
    (rover,) = yard.vehicles
    told = {name: EntityDescription(description=name) for name in ("rover", "other")}
    world = replace(yard.world, entities=told)
    others = replace(yard, vehicles=(rover, replace(rover, name="other")), world=world)
    assert with_world(lab, others).world.entities == {"rover": told["rover"]}


def test_a_run_without_a_world_keeps_its_vehicles(rovers: Scenario) -> None:
    empty = without_world(rovers)
    assert empty.vehicles == rovers.vehicles
    assert (has_world(rovers), has_world(empty)) == (True, False)
    assert len(solids(empty)) == 1
    assert has_world(with_world(rovers, rovers))


def test_worlds_of_equal_bodies_are_told_apart(yard: Scenario) -> None:
    known = {world_hash(yard): yard}
    foggy = replace(yard, world=replace(yard.world, weather=Weather(fog_visibility_m=50.0)))
    assert distinct(yard, known) is yard
    assert distinct(foggy, {}) is foggy
    told_apart = distinct(foggy, known)
    assert world_hash(told_apart) != world_hash(yard)
    assert told_apart == distinct(foggy, known), "always the same one"
    assert told_apart.world.weather == foggy.world.weather


def test_what_is_added_makes_no_other_world(yard: Scenario) -> None:
    more = replace(yard.world, solids=yard.world.solids[1:], actors=(), materials={})
    assert not is_other_world(yard, replace(yard, world=more))
    assert is_other_world(yard, load("indoor_lab"))
    assert is_other_world(yard, without_world(yard))


def test_a_process_follows_the_world_and_keeps_its_vehicles(
    rovers: Scenario, yard: Scenario
) -> None:
    known = replace(rovers, vehicles=rovers.vehicles[::-1])
    present = with_world(rovers, yard)
    followed = in_present_world(known, replace(present, vehicles=present.vehicles[:1]))
    assert followed.world == present.world
    assert [v.name for v in followed.vehicles] == ["second", "first"]
    assert followed.vehicles[1].placement == yard.vehicles[0].placement
    assert followed.vehicles[0] == rovers.vehicles[1]
