# SPDX-License-Identifier: Apache-2.0
"""The objects of a world have numbers, classes and boxes, and every part belongs to one."""

import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.schema import Scenario
from groundlink.scene.build import solids
from groundlink.scene.entities import box_around, in_frame, static_entities
from groundlink.scene.object_labels import CLASSES, FIRST_OF_WORLD, object_labels
from groundlink.world.actors import Actor, EntityDescription, FreeMotion, PersonForm
from groundlink.world.solids import Box, Solid

SHIPPED_WORLDS = ("indoor_lab", "outdoor_paper", "yard", "scanned_room")


def shipped(name: str) -> Scenario:
    return load(SHIPPED / f"{name}.yaml")


@pytest.mark.parametrize("name", SHIPPED_WORLDS)
def test_every_solid_belongs_to_an_object_and_every_object_has_a_class(name: str) -> None:
    scenario = shipped(name)
    table = object_labels(scenario)
    assert {solid.name for solid in solids(scenario)} == table.number_of_solid.keys()
    for object_name, number in table.number_of.items():
        assert table.objects[number - 1].name == object_name
    assert {one.class_id for one in table.objects} <= set(table.classes.values())
    assert list(table.classes)[: len(CLASSES)] == list(CLASSES)
    own = [number for kind, number in table.classes.items() if kind not in CLASSES]
    assert own == list(range(FIRST_OF_WORLD, FIRST_OF_WORLD + len(own)))


def test_boxes_are_those_that_tools_are_told() -> None:
    scenario = shipped("indoor_lab")
    table, entities = object_labels(scenario), static_entities(scenario, {})
    boxed = {one.name: one for one in table.objects if one.box_m}
    assert {"rover", "door"} == boxed.keys() - entities.keys()
    for name in boxed.keys() & entities.keys():
        assert boxed[name].box_m == entities[name].box_m
        assert boxed[name].pose == entities[name].pose
    (leaf,) = (solid for solid in solids(scenario) if solid.name == "door_leaf")
    pose = leaf.position_m, leaf.orientation
    assert boxed["door"].box_m == box_around([in_frame(leaf, pose)])
    assert {"floor", "ceiling", "wall"} == {one.name for one in table.objects} - boxed.keys()


def test_classes_are_tags_models_kinds_and_names_without_numbers() -> None:
    scenario = shipped("yard")
    material = scenario.world.solids[0].material
    person = Actor(
        name="anna",
        form=PersonForm(shirt=material, trousers=material, skin=material),
        motion=FreeMotion(at_m=(0.0, 0.0, 0.0), mass_kg=70.0),
    )
    pallets = tuple(
        Solid(name, Box((1.0, 1.0, 1.0)), material) for name in ("pallet_1", "pallet_2", "thing")
    )
    described = {"thing": EntityDescription(tags=("bin", "blue")), "anna": EntityDescription()}
    world = replace(
        scenario.world,
        solids=(*scenario.world.solids, *pallets),
        actors=(person,),
        entities=described,
    )
    table = object_labels(replace(scenario, world=world))
    kinds = {number: kind for kind, number in table.classes.items()}
    found = {one.name: kinds[one.class_id] for one in table.objects}
    assert found["rover"] == "rover"
    assert found["anna"] == "person"
    assert found["pallet_1"] == found["pallet_2"] == "pallet"
    assert found["thing"] == "bin"
    assert found["ground"] == "ground"
    # What moves comes first, so its numbers do not depend on the static world.
    assert (table.number_of["rover"], table.number_of["anna"]) == (1, 2)


def test_more_classes_than_eight_bits_hold_are_refused() -> None:
    scenario = shipped("yard")
    material = scenario.world.solids[0].material
    many = tuple(
        Solid(f"kind{chr(97 + i % 26)}{i}x", Box((1.0,) * 3), material) for i in range(224)
    )
    with pytest.raises(UserError, match="that are not predefined; expected up to 223"):
        object_labels(replace(scenario, world=replace(scenario.world, solids=many)))
