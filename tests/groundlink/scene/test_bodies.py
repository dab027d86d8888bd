# SPDX-License-Identifier: Apache-2.0
"""Every body has one number and one name, whoever counts."""

import pytest
from msgspec.structs import replace

from groundlink.loader import load
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.scene.bodies import body_names, link_bodies
from groundlink.scene.build import WorldError, solids, world_hash
from groundlink.scene.spawn_checks import check_spawns
from groundlink.world.actors import Actor, CrateForm, FreeMotion
from groundlink.world.solids import Box, Solid

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


@pytest.fixture(scope="module")
def two() -> Scenario:
    """Two rovers of one model in the laboratory."""
    lab = load("indoor_lab")
    rover = lab.vehicles[0]
    second = replace(rover, name="second", placement=Placement(x_m=-2.6, yaw_deg=90.0))
    return replace(lab, vehicles=(rover, second))


def test_what_moves_comes_first_then_the_solids_as_they_are_built(two: Scenario) -> None:
    static = solids(two)
    names = body_names(two, static)
    links = ["base_link", *(f"{wheel}_wheel_link" for wheel in WHEELS)]
    assert link_bodies(two) == [f"{name}/{link}" for name in ("rover", "second") for link in links]
    assert list(names) == [*link_bodies(two), *(solid.name for solid in static)]
    assert len(set(names)) == len(names)


def test_a_solid_cannot_take_the_name_of_a_link(two: Scenario) -> None:
    box = Solid("second/base_link", Box((1.0, 1.0, 1.0)), "metal", (3.0, 3.0, 1.0))
    world = replace(two.world, solids=(*two.world.solids, box))
    with pytest.raises(WorldError, match="two bodies are named `second/base_link`"):
        solids(replace(two, world=world))


def test_actors_come_after_links(two: Scenario) -> None:
    crate = Actor(
        name="crate",
        form=CrateForm(material="wood"),
        motion=FreeMotion(at_m=(0.0, 0.0, 0.0), mass_kg=1.0),
    )
    made = replace(two, world=replace(two.world, actors=(crate,)))
    assert link_bodies(made) == [*link_bodies(two), "crate"]
    assert world_hash(made) != world_hash(two)
    twice = replace(made, world=replace(made.world, actors=(crate, crate)))
    with pytest.raises(WorldError, match="two bodies are named `crate`"):
        solids(twice)
    other = replace(crate, form=CrateForm(material="jelly"))
    with pytest.raises(WorldError, match=r"`world.actors\[0\].form.material`: no material `jelly`"):
        solids(replace(two, world=replace(two.world, actors=(other,))))


def test_start_inside_an_actor_is_refused(two: Scenario) -> None:
    at_m = (two.vehicles[0].placement.x_m, two.vehicles[0].placement.y_m, 0.0)
    crate = Actor(
        name="crate", form=CrateForm(material="wood"), motion=FreeMotion(at_m=at_m, mass_kg=1.0)
    )
    made = replace(two, world=replace(two.world, actors=(crate,)))
    with pytest.raises(WorldError, match="`rover` starts inside `crate`"):
        check_spawns(made, solids(made))
