# SPDX-License-Identifier: Apache-2.0
"""Features: what is announced is served, and what is not announced is refused."""

from typing import Any, NamedTuple

import pytest
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import (
    EntityCategory,
    EntityFilters,
    Resource,
    Result,
    SimulationState,
    TagsFilter,
)
from simulation_interfaces.srv import (
    DeleteEntity,
    GetAvailableWorlds,
    GetCurrentWorld,
    GetEntities,
    GetEntityBounds,
    GetEntityInfo,
    GetEntityState,
    GetNamedPoseBounds,
    GetNamedPoses,
    GetSimulationState,
    GetSimulatorFeatures,
    GetSpawnables,
    LoadWorld,
    ResetSimulation,
    SetEntityInfo,
    SetEntityState,
    SetSimulationState,
    SpawnEntities,
    SpawnEntity,
    StepSimulation,
    UnloadWorld,
)

from simulation_interfaces_tck.clause import clause
from simulation_interfaces_tck.client import SimulatorClient, fail
from simulation_interfaces_tck.features import CODES, INTERFACES, OPTIONS
from simulation_interfaces_tck.shapes import cube, octahedron

UNSUPPORTED = Result.RESULT_FEATURE_UNSUPPORTED
NOBODY = "tck_entity_that_does_not_exist"


class Probe(NamedTuple):
    """A call that a simulator without the feature refuses, and that changes nothing in others."""

    service: Any
    fields: dict[str, Any]
    also: tuple[int, ...] = ()
    """Codes that refuse the call, too."""


def _filtered(**fields: Any) -> Probe:
    return Probe(GetEntities, {"filters": EntityFilters(**fields)})


def _set(state: int) -> Probe:
    return Probe(SetSimulationState, {"state": SimulationState(state=state)})


_TAGS = TagsFilter(tags=["tck"])
_STRING = Resource(resource_string="<tck/>")

PROBES = {
    "SPAWNING": Probe(SpawnEntity, {}),
    "DELETING": Probe(DeleteEntity, {"entity": NOBODY}),
    "NAMED_POSES": Probe(GetNamedPoses, {}),
    "POSE_BOUNDS": Probe(GetNamedPoseBounds, {"name": NOBODY}),
    "ENTITY_TAGS": _filtered(tags=_TAGS),
    "ENTITY_BOUNDS": Probe(GetEntityBounds, {"entity": NOBODY}),
    "ENTITY_BOUNDS_BOX": _filtered(bounds=cube((0.0, 0.0, 0.0), 1.0)),
    "ENTITY_BOUNDS_CONVEX": _filtered(bounds=octahedron((0.0, 0.0, 0.0), 1.0)),
    "ENTITY_CATEGORIES": _filtered(categories=[EntityCategory()]),
    "SPAWNING_RESOURCE_STRING": Probe(
        SpawnEntity,
        {"name": NOBODY, "entity_resource": _STRING},
        also=(SpawnEntity.Response.UNSUPPORTED_FORMAT,),
    ),
    "ENTITY_STATE_GETTING": Probe(GetEntityState, {"entity": NOBODY}),
    "ENTITY_STATE_SETTING": Probe(SetEntityState, {"entity": NOBODY}),
    "ENTITY_INFO_GETTING": Probe(GetEntityInfo, {"entity": NOBODY}),
    "ENTITY_INFO_SETTING": Probe(SetEntityInfo, {"entity": NOBODY}),
    "SPAWNABLES": Probe(GetSpawnables, {}),
    "SIMULATION_RESET": Probe(ResetSimulation, {}),
    "SIMULATION_RESET_TIME": Probe(ResetSimulation, {"scope": ResetSimulation.Request.SCOPE_TIME}),
    "SIMULATION_RESET_STATE": Probe(
        ResetSimulation, {"scope": ResetSimulation.Request.SCOPE_STATE}
    ),
    "SIMULATION_RESET_SPAWNED": Probe(
        ResetSimulation, {"scope": ResetSimulation.Request.SCOPE_SPAWNED}
    ),
    "SIMULATION_STATE_GETTING": Probe(GetSimulationState, {}),
    "SIMULATION_STATE_SETTING": _set(SimulationState.STATE_PLAYING),
    "SIMULATION_STATE_PAUSE": _set(SimulationState.STATE_PAUSED),
    "STEP_SIMULATION_SINGLE": Probe(StepSimulation, {"steps": 1}),
    "STEP_SIMULATION_MULTIPLE": Probe(StepSimulation, {"steps": 2}),
    "WORLD_LOADING": Probe(LoadWorld, {}),
    "WORLD_RESOURCE_STRING": Probe(
        LoadWorld, {"world_resource": _STRING}, also=(LoadWorld.Response.UNSUPPORTED_FORMAT,)
    ),
    "WORLD_TAGS": Probe(GetAvailableWorlds, {"filter": _TAGS}),
    "WORLD_UNLOADING": Probe(UnloadWorld, {}),
    "WORLD_INFO_GETTING": Probe(GetCurrentWorld, {}),
    "AVAILABLE_WORLDS": Probe(GetAvailableWorlds, {}),
    "SPAWNING_ENTITIES": Probe(SpawnEntities, {}),
}
"""A call for each feature but STEP_SIMULATION_ACTION, whose interface is an action."""


@clause("SimulatorFeatures.msg: features", "GetSimulatorFeatures")
def test_features_are_codes_of_the_standard(simulator: SimulatorClient) -> None:
    """Each announced feature is one of the standard's codes."""
    codes = [*simulator.call(GetSimulatorFeatures).features.features]
    if unknown := sorted({*codes} - {*CODES.values()}):
        fail(f"GetSimulatorFeatures: expected codes of SimulatorFeatures.msg, got {unknown}")


@pytest.mark.parametrize("feature", OPTIONS)
@clause("SimulatorFeatures.msg: options of an interface")
def test_option_comes_with_its_interface(simulator: SimulatorClient, feature: str) -> None:
    """A feature that is an option of an interface is announced with the interface."""
    if not any(interface in simulator.announced for interface in OPTIONS[feature]):
        fail(f"{feature} is announced without {' or '.join(OPTIONS[feature])}")


@pytest.mark.parametrize("feature", INTERFACES)
@pytest.mark.announced_or_not
@clause("SimulatorFeatures.msg: features; Result.msg: RESULT_FEATURE_UNSUPPORTED")
def test_feature_is_announced_if_it_is_served(simulator: SimulatorClient, feature: str) -> None:
    """What is announced is served; what is not is not there, or refuses each call."""
    if feature in simulator.announced:
        _must_be_served(simulator, feature)
    elif _has_parent(simulator, feature):
        _must_be_refused(simulator, feature)
        pytest.skip("not announced")
    else:
        pytest.skip("not announced")


def _must_be_served(simulator: SimulatorClient, feature: str) -> None:
    for interface in INTERFACES[feature]:
        if not simulator.serves(interface):
            fail(f"{feature} is announced, but {simulator.name_of(interface)} is not served")
    if feature == "STEP_SIMULATION_MULTIPLE":
        if not (simulator.serves(StepSimulation) or simulator.serves(SimulateSteps)):
            fail(f"{feature} is announced, but no service or action that steps is served")


def _has_parent(simulator: SimulatorClient, feature: str) -> bool:
    parents = OPTIONS.get(feature)
    return parents is None or any(parent in simulator.announced for parent in parents)


def _must_be_refused(simulator: SimulatorClient, feature: str) -> None:
    if feature == "STEP_SIMULATION_ACTION":
        _must_refuse_goals(simulator)
        return
    probe = PROBES[feature]
    if simulator.serves(probe.service):
        simulator.expect((UNSUPPORTED, *probe.also), probe.service, **probe.fields)


def _must_refuse_goals(simulator: SimulatorClient) -> None:
    if not simulator.serves(SimulateSteps):
        return
    goal = SimulateSteps.Goal(steps=1)
    handle = simulator.wait_for(simulator.action().send_goal_async(goal), "SimulateSteps responds")
    if handle.accepted:
        done = simulator.wait_for(handle.get_result_async(), "SimulateSteps ends")
        simulator.check(UNSUPPORTED, done.result.result, "SimulateSteps", request={"steps": 1})
