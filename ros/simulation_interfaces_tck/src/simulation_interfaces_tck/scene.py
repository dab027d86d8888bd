# SPDX-License-Identifier: Apache-2.0
"""What clauses do to a simulator, and how it is put back: entities, state and world."""

import secrets
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from simulation_interfaces.msg import Resource, Result, SimulationState, SpawnResult
from simulation_interfaces.srv import (
    DeleteEntity,
    GetCurrentWorld,
    GetEntities,
    GetEntityInfo,
    GetEntityState,
    GetSimulationState,
    GetSpawnables,
    LoadWorld,
    ResetSimulation,
    SetEntityInfo,
    SetEntityState,
    SetSimulationState,
)

from .client import SimulatorClient, fail, not_tested
from .features import constants
from .resources import Definitions
from .shapes import pose_at, stamped

OK = Result.RESULT_OK
STOPPED = SimulationState.STATE_STOPPED
PLAYING = SimulationState.STATE_PLAYING
PAUSED = SimulationState.STATE_PAUSED
ALREADY = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
SPAWNERS = ("SPAWNING_ENTITIES", "SPAWNING")

STATES = {value: name for name, value in constants(SimulationState).items()}

MOST_SPAWNABLES = 10
"""How many spawnables are tried until one has the category looked for."""

Place = tuple[float, float, float]


class SimulatorScene:
    """Entities that clauses spawned, and the state and the world that the simulator had.

    Parameters
    ----------
    simulator
        The simulator under test.
    spawnable
        URI of a resource to spawn; empty: the first that GetSpawnables lists.
    definition
        Path of a file that defines an entity; empty: formats of the standard.
    world
        Path of a file of a world that can be loaded; empty: what the simulator names.
    origin
        Where to spawn, in meters in the world frame.
    spacing
        Distance between spawned entities along the x axis, in meters.
    tolerance
        Largest difference of a position read from the one set, in meters.
    """

    def __init__(
        self,
        simulator: SimulatorClient,
        spawnable: str,
        definition: str,
        world: str,
        origin: Place,
        spacing: float,
        tolerance: float,
    ) -> None:
        self.simulator = simulator
        self.tolerance = tolerance
        self.definitions = Definitions(
            simulator.features.spawn_formats, Path(definition) if definition else None
        )
        self.world_file = Path(world).resolve() if world else None
        self._spawnable = spawnable
        self._origin = origin
        self._spacing = spacing
        self.prefix = f"tck_{secrets.token_hex(3)}"
        """Start of the names of this session, which no entity of an earlier one has."""
        self.left: list[str] = []
        """Spawned entities that could not be removed."""
        self._names = 0
        self._places = 0
        self._spawned: list[str] = []
        self._existing: dict[str, tuple[Any, Any]] = {}
        self._state = self.state() if "SIMULATION_STATE_GETTING" in simulator.announced else -1
        self._world = self.world()

    # -- entities ---------------------------------------------------------------------------------

    def new_name(self) -> str:
        """Return a name that no entity has."""
        self._names += 1
        return f"{self.prefix}_{self._names}"

    def new_place(self) -> Place:
        """Return a free place beside those already used in this clause."""
        x, y, z = self._origin
        self._places += 1
        return (x + (self._places - 1) % 6 * self._spacing, y, z)

    @cached_property
    def resource(self) -> Any:
        """Resource that can be spawned."""
        if self._spawnable:
            return Resource(uri=self._spawnable)
        if "SPAWNABLES" in self.simulator.announced:
            for spawnable in self.simulator.call(GetSpawnables).spawnables:
                return spawnable.entity_resource
        not_tested("no resource is known that can be spawned; name one with --spawnable")

    def request(self, **fields: Any) -> dict[str, Any]:
        """Return the fields of a valid request to spawn, but for the given ones."""
        valid = {
            "name": self.new_name(),
            "entity_resource": self.resource,
            "initial_pose": stamped(pose_at(self.new_place())),
        }
        return valid | fields

    def try_spawn(self, feature: str, **fields: Any) -> Any:
        """Request a valid entity, but for the given fields; return result and entity_name."""
        spawned = self.simulator.spawn(feature, **self.request(**fields))
        if spawned.result.result == OK:
            self.note(spawned.entity_name)
        return spawned

    def expect_spawn(self, codes: int | tuple[int, ...], feature: str, **fields: Any) -> Any:
        """Spawn as `try_spawn`, with a result that must be one of the codes."""
        spawned = self.try_spawn(feature, **fields)
        name = "SpawnEntity" if feature == "SPAWNING" else "SpawnEntities"
        self.simulator.check(codes, spawned.result, name, SpawnResult, fields)
        return spawned

    def note(self, name: str) -> None:
        """Remember an entity that was spawned, to be removed after the clause."""
        self._spawned.append(name)

    def spawn(self, **fields: Any) -> str:
        """Spawn an entity with any interface that is announced; return its name."""
        for feature in SPAWNERS:
            if feature in self.simulator.announced:
                return str(self.expect_spawn(OK, feature, **fields).entity_name)
        not_tested(f"needs {' or '.join(SPAWNERS)}")

    def entity(self) -> str:
        """Spawn an entity, or take one that is there and is put back after the clause."""
        if any(feature in self.simulator.announced for feature in SPAWNERS):
            return self.spawn()
        for name in self.entities():
            announced = self.simulator.announced
            state = self.pose_of(name) if "ENTITY_STATE_GETTING" in announced else None
            info = self.info_of(name) if "ENTITY_INFO_GETTING" in announced else None
            self._existing.setdefault(name, (state, info))
            return name
        not_tested("no entity is there, and none can be spawned")

    def spawn_of(self, categories: Sequence[int]) -> str:
        """Spawn an entity of one of the categories."""
        if name := self._spawned_of(categories):
            return name
        listed = " or ".join(map(str, categories))
        not_tested(f"no resource is known that spawns an entity of category {listed}")

    def entity_of(self, category: int) -> str:
        """Return an entity of a category: one that is there, or a spawnable that becomes one."""
        for name in self.entities():
            if self.info_of(name).category.category == category:
                return name
        if name := self._spawned_of([category]):
            return name
        not_tested(f"no entity of category {category} is there or can be spawned")

    def _spawned_of(self, categories: Sequence[int]) -> str:
        resources = [self.resource]
        if "SPAWNABLES" in self.simulator.announced:
            spawnables = self.simulator.expect(OK, GetSpawnables).spawnables
            resources += [spawnable.entity_resource for spawnable in spawnables[:MOST_SPAWNABLES]]
        for resource in resources:
            name = self.spawn(entity_resource=resource)
            if self.info_of(name).category.category in categories:
                return name
            self.remove_spawned()
        return ""

    def entities(self, **filters: Any) -> list[str]:
        """Return the names of the entities; without GetEntities nothing is tested."""
        if not self.simulator.serves(GetEntities):
            not_tested("needs GetEntities")
        return list(self.simulator.expect(OK, GetEntities, **filters).entities)

    def must_have(self, name: str) -> None:
        """Fail unless GetEntities lists a name."""
        if name not in (listed := self.entities()):
            fail(f"GetEntities: expected {name!r} among the entities, got {listed}")

    def must_lack(self, name: str) -> None:
        """Fail if GetEntities lists a name."""
        if name in self.entities():
            fail(f"GetEntities: {name!r} is still listed")

    def pose_of(self, name: str) -> Any:
        """Return the EntityState of an entity."""
        self.simulator.need("ENTITY_STATE_GETTING")
        return self.simulator.expect(OK, GetEntityState, entity=name).state

    def nanos(self, name: str) -> int:
        """Return the simulated time: the stamp of an entity's state, or /clock without stamps.

        /clock may be published less often than there are steps.
        """
        if name and "ENTITY_STATE_GETTING" in self.simulator.announced:
            stamp = self.pose_of(name).header.stamp
            if stamp.sec or stamp.nanosec:
                return int(stamp.sec * 10**9 + stamp.nanosec)
        return self.simulator.clock_nanos()

    def info_of(self, name: str) -> Any:
        """Return the EntityInfo of an entity."""
        self.simulator.need("ENTITY_INFO_GETTING")
        return self.simulator.expect(OK, GetEntityInfo, entity=name).info

    # -- state ------------------------------------------------------------------------------------

    def state(self) -> int:
        """Return the state of the simulation."""
        self.simulator.need("SIMULATION_STATE_GETTING")
        return int(self.simulator.expect(OK, GetSimulationState).state.state)

    def must_be(self, state: int) -> None:
        """Fail unless the simulation is in a state, if its state can be read."""
        if "SIMULATION_STATE_GETTING" in self.simulator.announced and self.state() != state:
            fail(f"GetSimulationState: expected {STATES[state]}, got {STATES[self.state()]}")

    def set_state(self, state: int, *codes: int) -> None:
        """Set the state of the simulation; the result must be one of the codes."""
        wanted = SimulationState(state=state)
        self.simulator.expect(codes or (OK,), SetSimulationState, state=wanted)

    def bring_to(self, state: int) -> None:
        """Bring the simulation into a state; where that is impossible nothing is tested."""
        self.simulator.need("SIMULATION_STATE_SETTING")
        if state == PAUSED:
            self.simulator.need("SIMULATION_STATE_PAUSE")
            if self._state_now() == STOPPED:  # not every simulator pauses from here
                self.set_state(PLAYING)
        if self._state_now() != state:
            self.set_state(state, OK, ALREADY)

    def hold_still(self) -> None:
        """Pause the simulation if that is possible, so that nothing moves by itself."""
        if {"SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE"} <= self.simulator.announced:
            self.bring_to(PAUSED)

    def reset(self, scope: int) -> None:
        """Reset the simulation."""
        self.simulator.expect(OK, ResetSimulation, scope=scope)

    def _state_now(self) -> int:
        can = "SIMULATION_STATE_GETTING" in self.simulator.announced
        return self.state() if can else -1

    # -- world ------------------------------------------------------------------------------------

    def world(self) -> Any:
        """Return the WorldResource of the current world, or None."""
        if "WORLD_INFO_GETTING" not in self.simulator.announced:
            return None
        response = self.simulator.call(GetCurrentWorld)
        return response.world if response.result.result == OK else None

    def load_again(self) -> None:
        """Load the world that the simulator had."""
        if self._world is None:
            not_tested("the current world is not known, so it could not be loaded again")
        self.simulator.need("WORLD_LOADING")
        self.simulator.expect(OK, LoadWorld, world_resource=self._world.world_resource)

    # -- putting back -----------------------------------------------------------------------------

    def put_back(self) -> None:
        """Remove what was spawned; set the state of before, and the world."""
        announced = self.simulator.announced
        if self._world is not None and "WORLD_LOADING" in announced:
            world = self.world()
            if world is None or world.world_resource != self._world.world_resource:
                self.load_again()
        self.remove_spawned()
        for name, (state, info) in self._existing.items():
            if state is not None and "ENTITY_STATE_SETTING" in announced:
                flags = {"set_pose": True, "set_twist": True}
                self.simulator.call(SetEntityState, entity=name, state=state, **flags)
            if info is not None and "ENTITY_INFO_SETTING" in announced:
                self.simulator.call(SetEntityInfo, entity=name, info=info)
        self._existing.clear()
        self._places = 0
        if self._state in (STOPPED, PLAYING, PAUSED) and "SIMULATION_STATE_SETTING" in announced:
            self.bring_to(self._state)

    def remove_spawned(self) -> None:
        """Remove what was spawned, if that is possible."""
        spawned, self._spawned = self._spawned, []
        if "DELETING" in self.simulator.announced:
            for name in spawned:
                code = self.simulator.call(DeleteEntity, entity=name).result.result
                if code not in (OK, Result.RESULT_NOT_FOUND):
                    self.left.append(name)
        elif spawned and "SIMULATION_RESET_SPAWNED" in self.simulator.announced:
            self.reset(ResetSimulation.Request.SCOPE_SPAWNED)
        else:
            self.left += spawned
