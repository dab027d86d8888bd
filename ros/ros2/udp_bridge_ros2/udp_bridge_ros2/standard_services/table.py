# SPDX-License-Identifier: Apache-2.0
"""Table of the services and the action: name, type, feature codes and handler."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from simulation_interfaces import action as action_types
from simulation_interfaces import srv as service_types
from simulation_interfaces.msg import SimulatorFeatures

from udp_bridge.node.command_client import RunCommandClient
from udp_bridge.node.run_control import RunControl

from .entities import EntityServices
from .named_poses import NamedPoseServices
from .results import ServiceHandler, service_callback
from .run_state import RunStateServices
from .spawning import FORMATS, SpawnServices
from .world_queries import WorldQueries
from .worlds import WorldServices

NOTE = (
    "A step is a tick of 2.5 ms. Changes take effect between two ticks. Time is reset together "
    "with the state only (scope 3, 7 or 255)."
)


class ServiceRow(NamedTuple):
    """A service or action of the standard."""

    name: str
    type_name: str
    handler: Callable[..., Any]
    features: tuple[str, ...] = ()
    """Features that it gives to clients, named as in SimulatorFeatures."""


class StandardServices:
    """What is served, of the types that the installed version of the standard has."""

    def __init__(self, client: RunCommandClient) -> None:
        queries = WorldQueries(client.ask)
        services, actions = _table(RunControl(client), queries)
        self._services = [row for row in services if hasattr(service_types, row.type_name)]
        self._actions = [row for row in actions if hasattr(action_types, row.type_name)]

    def services(self) -> list[tuple[str, Any, ServiceHandler]]:
        """Return name, type and callback of each service."""
        return [
            ("get_simulator_features", service_types.GetSimulatorFeatures, self._get_features),
            *(
                (row.name, getattr(service_types, row.type_name), service_callback(row.handler))
                for row in self._services
            ),
        ]

    def actions(self) -> list[tuple[str, Any, Callable[[Any], Any]]]:
        """Return name, type and callback of each action."""
        return [
            (row.name, getattr(action_types, row.type_name), row.handler) for row in self._actions
        ]

    def _get_features(self, _: Any, response: Any) -> Any:
        names = {name for row in (*self._services, *self._actions) for name in row.features}
        codes = sorted(
            getattr(SimulatorFeatures, name) for name in names if hasattr(SimulatorFeatures, name)
        )
        response.features = SimulatorFeatures(
            features=codes, spawn_formats=FORMATS, custom_info=NOTE
        )
        return response


def _table(run: RunControl, queries: WorldQueries) -> tuple[list[ServiceRow], list[ServiceRow]]:
    """Return the services and the actions."""
    state = RunStateServices(run, queries)
    entities = EntityServices(queries)
    spawning = SpawnServices(queries)
    poses = NamedPoseServices(queries)
    worlds = WorldServices(queries, state)
    services = [
        ServiceRow(
            "get_simulation_state",
            "GetSimulationState",
            state.get_state,
            ("SIMULATION_STATE_GETTING",),
        ),
        ServiceRow(
            "set_simulation_state",
            "SetSimulationState",
            state.set_state,
            ("SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE"),
        ),
        ServiceRow(
            "step_simulation",
            "StepSimulation",
            state.step,
            ("STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE"),
        ),
        ServiceRow(
            "reset_simulation",
            "ResetSimulation",
            state.reset,
            # Not SIMULATION_RESET_TIME: time is reset together with the state only.
            ("SIMULATION_RESET", "SIMULATION_RESET_STATE", "SIMULATION_RESET_SPAWNED"),
        ),
        ServiceRow(
            "get_entities",
            "GetEntities",
            entities.names,
            ("ENTITY_TAGS", "ENTITY_CATEGORIES", "ENTITY_BOUNDS_BOX", "ENTITY_BOUNDS_CONVEX"),
        ),
        ServiceRow("get_entities_states", "GetEntitiesStates", entities.states),
        ServiceRow(
            "get_entity_state", "GetEntityState", entities.get_state, ("ENTITY_STATE_GETTING",)
        ),
        ServiceRow(
            "set_entity_state", "SetEntityState", entities.set_state, ("ENTITY_STATE_SETTING",)
        ),
        ServiceRow("get_entity_info", "GetEntityInfo", entities.get_info, ("ENTITY_INFO_GETTING",)),
        ServiceRow("set_entity_info", "SetEntityInfo", entities.set_info, ("ENTITY_INFO_SETTING",)),
        ServiceRow("get_entity_bounds", "GetEntityBounds", entities.get_bounds, ("ENTITY_BOUNDS",)),
        ServiceRow(
            "spawn_entity",
            "SpawnEntity",
            spawning.spawn_entity,
            ("SPAWNING", "SPAWNING_RESOURCE_STRING"),
        ),
        ServiceRow(
            "spawn_entities", "SpawnEntities", spawning.spawn_entities, ("SPAWNING_ENTITIES",)
        ),
        ServiceRow("delete_entity", "DeleteEntity", spawning.delete_entity, ("DELETING",)),
        ServiceRow("get_spawnables", "GetSpawnables", spawning.get_spawnables, ("SPAWNABLES",)),
        ServiceRow("get_named_poses", "GetNamedPoses", poses.poses, ("NAMED_POSES",)),
        ServiceRow("get_named_pose_bounds", "GetNamedPoseBounds", poses.bounds, ("POSE_BOUNDS",)),
        ServiceRow("get_current_world", "GetCurrentWorld", worlds.current, ("WORLD_INFO_GETTING",)),
        ServiceRow(
            "load_world", "LoadWorld", worlds.load, ("WORLD_LOADING", "WORLD_RESOURCE_STRING")
        ),
        ServiceRow("unload_world", "UnloadWorld", worlds.unload, ("WORLD_UNLOADING",)),
        ServiceRow(
            "get_available_worlds",
            "GetAvailableWorlds",
            worlds.available,
            ("AVAILABLE_WORLDS", "WORLD_TAGS"),
        ),
    ]
    actions = [
        ServiceRow(
            "simulate_steps",
            "SimulateSteps",
            state.simulate_steps,
            ("STEP_SIMULATION_ACTION", "STEP_SIMULATION_MULTIPLE"),
        )
    ]
    return services, actions
