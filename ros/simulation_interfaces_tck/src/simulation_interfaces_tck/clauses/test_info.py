# SPDX-License-Identifier: Apache-2.0
"""Reading and setting category, description and tags of an entity."""

from simulation_interfaces.msg import EntityCategory, EntityInfo, Result
from simulation_interfaces.srv import GetEntityInfo, SetEntityInfo

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import fail
from simulation_interfaces_tck.features import constants
from simulation_interfaces_tck.scene import OK, SimulatorScene

NOT_FOUND = Result.RESULT_NOT_FOUND


@clause("Result.msg: RESULT_NOT_FOUND", "ENTITY_INFO_GETTING")
def test_info_of_an_unknown_entity_is_not_found(scene: SimulatorScene) -> None:
    """An entity that does not exist has no information."""
    scene.simulator.expect(NOT_FOUND, GetEntityInfo, entity=scene.new_name())


@clause("EntityCategory.msg: category", "ENTITY_INFO_GETTING")
def test_category_is_one_of_the_standard(scene: SimulatorScene) -> None:
    """The category is one of the constants."""
    got = scene.info_of(scene.entity()).category.category
    known = constants(EntityCategory).values()
    if got not in known:
        fail(f"GetEntityInfo: expected a category of {sorted(known)}, got {got}")


@clause("Result.msg: RESULT_NOT_FOUND", "ENTITY_INFO_SETTING")
def test_info_of_an_unknown_entity_is_not_set(scene: SimulatorScene) -> None:
    """Information about an entity that does not exist can't be set."""
    scene.simulator.expect(NOT_FOUND, SetEntityInfo, entity=scene.new_name())


@clause("SetEntityInfo.srv: info", "ENTITY_INFO_SETTING", needs=["ENTITY_INFO_GETTING"])
def test_info_that_was_set_is_read_back(scene: SimulatorScene) -> None:
    """Category, description and tags are those that were set."""
    human = EntityCategory(category=EntityCategory.CATEGORY_HUMAN)
    _set_and_read(scene, scene.entity(), EntityInfo(category=human, description="a", tags=["b"]))


@clause("SetEntityInfo.srv: info", "ENTITY_INFO_SETTING", needs=["ENTITY_INFO_GETTING"])
def test_info_overrides_what_was_set_before(scene: SimulatorScene) -> None:
    """Nothing of earlier information stays."""
    name = scene.entity()
    human = EntityCategory(category=EntityCategory.CATEGORY_HUMAN)
    _set_and_read(scene, name, EntityInfo(category=human, description="a", tags=["b", "c"]))
    _set_and_read(scene, name, EntityInfo(tags=["d"]))


def _set_and_read(scene: SimulatorScene, name: str, info: EntityInfo) -> None:
    scene.simulator.expect(OK, SetEntityInfo, entity=name, info=info)
    got = scene.info_of(name)
    if (got.category, got.description, sorted(got.tags)) != (
        info.category,
        info.description,
        sorted(info.tags),
    ):
        fail(f"GetEntityInfo: expected {info}, got {got}")
