# SPDX-License-Identifier: Apache-2.0
"""Entities of an episode: what it knows of them beside the scenario, and how tools see them.

The registry follows from the journal, so a restored episode has the same one.
"""

from collections.abc import Mapping

from msgspec import Struct
from msgspec.structs import replace

from groundlink.episode.control import Move, Spawn, WorldChange
from groundlink.episode.world_queries import EntityReport
from groundlink.scenario.additions import SolidGroup
from groundlink.scenario.schema import Scenario
from groundlink.scene.build import solids
from groundlink.scene.entities import (
    Pose,
    actor_category,
    box_around,
    static_entities,
    vehicle_solids,
)
from groundlink.scene.place_checks import PlaceChecks
from groundlink.scene.spawn_pose import collision_solids
from groundlink.world.actors import Category, EntityDescription, form_solids
from groundlink.world.solids import Solid
from services.physics.dynamics.backend import Twist

STILL: Twist = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class EntityMemory(Struct, frozen=True, array_like=True):
    """Content of an `EntityRegistry`."""

    groups: dict[str, SolidGroup] = {}
    descriptions: dict[str, EntityDescription] = {}
    first_groups: dict[str, SolidGroup] = {}
    first_poses: dict[str, Pose] = {}


NO_ENTITIES = EntityMemory()
"""Of a world that nothing has changed."""


class EntityRegistry:
    """Spawned groups of solids, first poses of what was moved, and descriptions.

    Attributes
    ----------
    groups
        groups of static solids that were spawned as one entity, by name.
    descriptions
        what tools are told of entities, by name, in place of the scenario's.
    """

    def __init__(self, memory: EntityMemory = NO_ENTITIES) -> None:
        self.groups: dict[str, SolidGroup] = dict(memory.groups)
        self.descriptions: dict[str, EntityDescription] = dict(memory.descriptions)
        self._first_groups: dict[str, SolidGroup] = dict(memory.first_groups)
        self._first_poses: dict[str, Pose] = dict(memory.first_poses)
        """Poses of moved solids before they were moved."""

    def memory(self) -> EntityMemory:
        """Return what another registry continues with."""
        return EntityMemory(
            dict(self.groups),
            dict(self.descriptions),
            dict(self._first_groups),
            dict(self._first_poses),
        )

    def changed(self, change: WorldChange, before: Scenario, after: Scenario) -> None:
        """Record a change of the world; `before` and `after` are its scenarios."""
        match change:
            case Spawn(group=SolidGroup() as added):
                self.groups[added.name] = added
            case Move(name=name, position_m=position_m, orientation=orientation, solids=poses):
                # Until the first change, clutter is not among the world's solids.
                for solid in solids(before) if before.world.clutter else before.world.solids:
                    if solid.name in poses:
                        first = solid.position_m, solid.orientation
                        self._first_poses.setdefault(solid.name, first)
                if (group := self.groups.get(name)) is not None:
                    self._first_groups.setdefault(name, group)
                    self.groups[name] = replace(
                        group, position_m=position_m, orientation=orientation
                    )
        there = {solid.name for solid in after.world.solids}
        self.groups = {
            n: group for n, group in self.groups.items() if there.issuperset(group.parts)
        }

    def describe(self, name: str, description: EntityDescription | None) -> None:
        """Set or forget the description of an entity."""
        if description is None:
            del self.descriptions[name]
        else:
            self.descriptions[name] = description

    def moved_back(self, scenario: Scenario) -> Scenario:
        """Return a scenario whose moved solids are where they were first, and record that."""
        self.groups |= self._first_groups
        first, self._first_poses, self._first_groups = self._first_poses, {}, {}
        if not first:
            return scenario
        back = []
        for solid in scenario.world.solids:
            position_m, orientation = first.get(solid.name, (solid.position_m, solid.orientation))
            back.append(replace(solid, position_m=position_m, orientation=orientation))
        return replace(scenario, world=replace(scenario.world, solids=tuple(back)))


class WorldView:
    """A world as tools see it: boxes, categories and poses of its entities.

    Parameters
    ----------
    groups
        of static solids, by name.
    """

    def __init__(self, scenario: Scenario, groups: Mapping[str, SolidGroup]) -> None:
        self.scenario, self.groups = scenario, groups
        self.checks = PlaceChecks(scenario)
        self.statics = static_entities(scenario, groups)
        self.vehicles = {vehicle.name: vehicle for vehicle in scenario.vehicles}
        self.actors = {actor.name: actor for actor in scenario.world.actors}
        self.parts = {name: vehicle_solids(v.model) for name, v in self.vehicles.items()}
        """Solids of vehicles and actors in their frames, by name."""

        self.parts |= {name: form_solids(actor.form) for name, actor in self.actors.items()}
        self._boxes = {name: box_around(parts) for name, parts in self.parts.items()}

    def names(self) -> list[str]:
        """Return the names of all entities: vehicles, actors, then static ones."""
        return [*self.vehicles, *self.actors, *self.statics]

    def bodies(self, name: str) -> list[Solid]:
        """Return the collision solids of a vehicle or an actor in its frame, without wheels."""
        vehicle = self.vehicles.get(name)
        return self.parts[name] if vehicle is None else collision_solids(vehicle.model)

    def report(
        self,
        name: str,
        given: EntityDescription | None,
        motion: tuple[Pose, Twist] | None,
        acceleration: Twist,
    ) -> EntityReport:
        """Return what tools are told of an entity.

        Parameters
        ----------
        given
            description in place of the scenario's.
        motion
            pose and velocity of a vehicle or an actor; None: a static entity.
        """
        low, high = self._boxes[name] if name in self._boxes else self.statics[name].box_m
        pose, twist = motion or (self.statics[name].pose, STILL)
        told = given or self._described(name)
        return EntityReport(
            name=name,
            category=told.category or self._category(name),
            description=told.description,
            tags=told.tags,
            is_static=motion is None,
            position_m=pose[0],
            orientation=pose[1],
            linear_mps=twist[0],
            angular_radps=twist[1],
            linear_mps2=acceleration[0],
            angular_radps2=acceleration[1],
            low_m=low,
            high_m=high,
        )

    def _described(self, name: str) -> EntityDescription:
        return self.scenario.world.entities.get(name, EntityDescription())

    def _category(self, name: str) -> Category:
        if name in self.vehicles:
            return "robot"
        if (actor := self.actors.get(name)) is not None:
            return actor_category(actor)
        group = self.groups.get(name)
        return "static_object" if group is None else group.category
