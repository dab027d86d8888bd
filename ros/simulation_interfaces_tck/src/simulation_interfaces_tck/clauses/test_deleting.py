# SPDX-License-Identifier: Apache-2.0
"""Deleting an entity."""

from simulation_interfaces.msg import Result
from simulation_interfaces.srv import DeleteEntity, GetEntityState

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.scene import OK, SimulatorScene

NOT_FOUND = Result.RESULT_NOT_FOUND


@clause("DeleteEntity.srv: description", "DELETING")
def test_deleted_entity_is_not_listed(scene: SimulatorScene) -> None:
    """A deleted entity is removed from the simulation."""
    name = scene.spawn()
    scene.simulator.expect(OK, DeleteEntity, entity=name)
    scene.must_lack(name)


@clause("Result.msg: RESULT_NOT_FOUND", "DELETING", needs=["ENTITY_STATE_GETTING"])
def test_deleted_entity_has_no_state(scene: SimulatorScene) -> None:
    """The state of a deleted entity is not found."""
    name = scene.spawn()
    scene.simulator.expect(OK, DeleteEntity, entity=name)
    scene.simulator.expect(NOT_FOUND, GetEntityState, entity=name)


@clause("Result.msg: RESULT_NOT_FOUND", "DELETING")
def test_unknown_entity_is_not_found(scene: SimulatorScene) -> None:
    """An entity that does not exist can't be deleted."""
    scene.simulator.expect(NOT_FOUND, DeleteEntity, entity=scene.new_name())


@clause("Result.msg: RESULT_NOT_FOUND", "DELETING")
def test_deleted_entity_is_not_found_again(scene: SimulatorScene) -> None:
    """An entity is deleted once."""
    name = scene.spawn()
    scene.simulator.expect(OK, DeleteEntity, entity=name)
    scene.simulator.expect(NOT_FOUND, DeleteEntity, entity=name)


@clause("SpawnResult.msg: NAME_NOT_UNIQUE", "DELETING")
def test_name_of_a_deleted_entity_is_free(scene: SimulatorScene) -> None:
    """The name of a deleted entity can be given again."""
    name = scene.spawn()
    scene.simulator.expect(OK, DeleteEntity, entity=name)
    scene.spawn(name=name)
