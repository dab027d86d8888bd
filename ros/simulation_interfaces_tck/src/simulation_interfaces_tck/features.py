# SPDX-License-Identifier: Apache-2.0
"""Features of the standard: their codes, and the services and action of each."""

from typing import Any

from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import SimulatorFeatures
from simulation_interfaces.srv import (
    DeleteEntity,
    GetAvailableWorlds,
    GetCurrentWorld,
    GetEntities,
    GetEntitiesStates,
    GetEntityBounds,
    GetEntityInfo,
    GetEntityState,
    GetNamedPoseBounds,
    GetNamedPoses,
    GetSimulationState,
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

INTERFACES: dict[str, tuple[Any, ...]] = {
    "SPAWNING": (SpawnEntity,),
    "DELETING": (DeleteEntity,),
    "NAMED_POSES": (GetNamedPoses,),
    "POSE_BOUNDS": (GetNamedPoseBounds,),
    "ENTITY_TAGS": (GetEntities,),
    "ENTITY_BOUNDS": (GetEntityBounds,),
    "ENTITY_BOUNDS_BOX": (GetEntities,),
    "ENTITY_BOUNDS_CONVEX": (GetEntities,),
    "ENTITY_CATEGORIES": (GetEntities,),
    "SPAWNING_RESOURCE_STRING": (),
    "ENTITY_STATE_GETTING": (GetEntityState, GetEntitiesStates),
    "ENTITY_STATE_SETTING": (SetEntityState,),
    "ENTITY_INFO_GETTING": (GetEntityInfo,),
    "ENTITY_INFO_SETTING": (SetEntityInfo,),
    "SPAWNABLES": (GetSpawnables,),
    "SIMULATION_RESET": (ResetSimulation,),
    "SIMULATION_RESET_TIME": (ResetSimulation,),
    "SIMULATION_RESET_STATE": (ResetSimulation,),
    "SIMULATION_RESET_SPAWNED": (ResetSimulation,),
    "SIMULATION_STATE_GETTING": (GetSimulationState,),
    "SIMULATION_STATE_SETTING": (SetSimulationState,),
    "SIMULATION_STATE_PAUSE": (SetSimulationState,),
    "STEP_SIMULATION_SINGLE": (StepSimulation,),
    "STEP_SIMULATION_MULTIPLE": (),
    "STEP_SIMULATION_ACTION": (SimulateSteps,),
    "WORLD_LOADING": (LoadWorld,),
    "WORLD_RESOURCE_STRING": (LoadWorld,),
    "WORLD_TAGS": (GetAvailableWorlds,),
    "WORLD_UNLOADING": (UnloadWorld,),
    "WORLD_INFO_GETTING": (GetCurrentWorld,),
    "AVAILABLE_WORLDS": (GetAvailableWorlds,),
    "SPAWNING_ENTITIES": (SpawnEntities,),
}
"""What must be served for each feature. An empty row: one of several interfaces is enough."""

OPTIONS: dict[str, tuple[str, ...]] = {
    "SPAWNING_RESOURCE_STRING": ("SPAWNING", "SPAWNING_ENTITIES"),
    "SIMULATION_RESET_TIME": ("SIMULATION_RESET",),
    "SIMULATION_RESET_STATE": ("SIMULATION_RESET",),
    "SIMULATION_RESET_SPAWNED": ("SIMULATION_RESET",),
    "SIMULATION_STATE_PAUSE": ("SIMULATION_STATE_SETTING",),
    "STEP_SIMULATION_MULTIPLE": ("STEP_SIMULATION_SINGLE", "STEP_SIMULATION_ACTION"),
    "WORLD_RESOURCE_STRING": ("WORLD_LOADING",),
    "WORLD_TAGS": ("AVAILABLE_WORLDS",),
}
"""Features that are options of an interface, each with the features that announce it."""

CODES: dict[str, int] = {name: int(getattr(SimulatorFeatures, name)) for name in INTERFACES}


def constants(message: Any) -> dict[str, int]:
    """Return the numeric constants of a message class, by name."""
    names = [name for name in dir(type(message)) if name.isupper() and not name.startswith("_")]
    return {name: value for name in names if isinstance(value := getattr(message, name), int)}
