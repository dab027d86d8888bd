# SPDX-License-Identifier: Apache-2.0
"""Base of the actions of `osc.groundlink`, and those that change the world or a sensor."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import yaml
from py_trees.common import Status
from scenario_execution.actions.base_action import BaseAction
from scenario_execution.simulation import Clock

from groundlink.core.errors import UserError
from groundlink.core.frames import quaternion_from_rpy
from groundlink.episode.world_queries import SpawnQuery
from groundlink.scenario.faults import Fault, fault_from

from .simulation import GroundlinkSimulation

OscActor = Mapping[str, Any]
"""The actor of an action, as scenario-execution describes it: `name` is that of its variable."""


class EntityAction(BaseAction):  # type: ignore[misc]
    """An action of an entity. A mistake in the scenario fails it with one line."""

    simulation: GroundlinkSimulation
    clock: Clock

    def __init__(self, associated_actor: OscActor) -> None:
        super().__init__()
        self.entity: str = associated_actor["name"]
        """Name of the action's actor."""

    def setup(self, **kwargs: Any) -> None:
        """Take the simulation and its clock."""
        self.simulation = self.get_simulation(kwargs)
        self.clock = kwargs["clock"]

    def update(self) -> Status:
        """Return the state of the action at this tick."""
        try:
            return self.tick_action()
        except UserError as mistake:
            return self.failed(str(mistake))

    @abstractmethod
    def tick_action(self) -> Status:
        """Do what is due at this tick.

        Raises
        ------
        UserError
            if the action fails.
        """

    def failed(self, reason: str) -> Status:
        """Log why the action fails, also for the JUnit file."""
        self.feedback_message = reason
        self.logger.error(f"{self.entity}: {self.name}: {reason}")
        return Status.FAILURE


class ChangeAction(EntityAction):
    """An action that is done at one tick."""

    change: Callable[[], None]
    """What it does."""

    def tick_action(self) -> Status:
        """Do it."""
        self.change()
        return Status.SUCCESS


class SpawnAction(ChangeAction):
    """Adds an entity to the world."""

    def execute(
        self, associated_actor: OscActor, what: str, pose: Mapping[str, Mapping[str, float]]
    ) -> None:
        """Take the arguments of `entity.spawn`."""
        position, turns = pose["position"], pose["orientation"]
        query = SpawnQuery(
            uri=self.simulation.path(what),
            name=self.entity,
            position_m=(position["x"], position["y"], position["z"]),
            orientation=quaternion_from_rpy(turns["roll"], turns["pitch"], turns["yaw"]),
        )
        self.change = lambda: self.simulation.spawn(query)


class DeleteAction(ChangeAction):
    """Removes an entity from the world."""

    def execute(self, associated_actor: OscActor) -> None:
        """Take the arguments of `entity.delete`."""
        self.change = lambda: self.simulation.delete(self.entity)


class FailSensor(ChangeAction):
    """Injects a fault into a sensor."""

    def execute(self, associated_actor: OscActor, sensor: str, fault: str) -> None:
        """Take the arguments of `vehicle.fail_sensor`."""
        self.change = lambda: self.simulation.fault(f"{self.entity}/{sensor}", parsed_fault(fault))


class RepairSensor(ChangeAction):
    """Ends all faults of a sensor."""

    def execute(self, associated_actor: OscActor, sensor: str) -> None:
        """Take the arguments of `vehicle.repair_sensor`."""
        self.change = lambda: self.simulation.fault(f"{self.entity}/{sensor}", None)


def parsed_fault(text: str) -> Fault:
    """Return the fault of a line of YAML, as in a scenario.

    Raises
    ------
    UserError
        if it is none.
    """
    try:
        return fault_from(yaml.safe_load(text))
    except (yaml.YAMLError, UserError) as problem:
        reason = " ".join(str(problem).split())
        raise UserError(
            f"fault: {reason}; expected a fault as in a scenario, such as "
            f"{{kind: stuck, for_s: 2}}, got `{text}`"
        ) from None
