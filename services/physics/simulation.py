# SPDX-License-Identifier: Apache-2.0
"""The physics of a run: a world and its vehicles, stepped tick by tick.

Rule: commands and steps in, states out. The same calls give the same bytes; nothing here reads a
clock or knows how fast time should pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

from groundlink.clock import TICK_NANOS
from groundlink.messages import Command, VehicleState
from groundlink.scenario.schema import Scenario
from groundlink.vitals import Vitals
from groundlink.world.solids import Solid, Sphere

from .engine import Engine
from .statics import add_statics
from .vehicle import SimulatedVehicle


class Simulation:
    """A PyBullet world of its own, at tick zero with every vehicle standing still.

    Parameters
    ----------
    scenario
        gives materials and vehicles.
    solids
        all static solids of the world, in the world's frame.
    epoch_nanos
        stamp of sim time zero on the time line of commands.
    """

    def __init__(
        self, scenario: Scenario, solids: Sequence[Solid], *, epoch_nanos: int = 0
    ) -> None:
        self.tick = 0
        self._engine = Engine()
        materials = scenario.world.materials
        # What every chassis passes over must be rolled over, or nothing would touch it.
        clearance_m = min(
            (
                model.base_height_m + model.chassis.center_m[2] - model.chassis.size_m[2] / 2
                for model in (vehicle.model for vehicle in scenario.vehicles)
            ),
            default=0.0,
        )
        statics = add_statics(self._engine, solids, materials, ground_below_m=clearance_m)
        frictions = {body: static.friction for body, static in statics.items()}
        self._vehicles = {
            vehicle.name: SimulatedVehicle(
                self._engine, vehicle, materials, frictions, epoch_nanos=epoch_nanos
            )
            for vehicle in scenario.vehicles
        }
        self._bodies: dict[int, Sequence[Solid]] = {b: s.solids for b, s in statics.items()}
        for vehicle in scenario.vehicles:
            # Another vehicle is met as a whole: it has one name, wherever it is.
            whole = Solid(vehicle.name, Sphere(radius_m=1.0), "")
            self._bodies[self._vehicles[vehicle.name].body] = (whole,)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the engine; call nothing else after it."""
        self._engine.close()

    @property
    def sim_nanos(self) -> int:
        """Sim time of the present tick."""
        return self.tick * TICK_NANOS

    def command(self, vehicle_name: str, command: Command) -> None:
        """Ask a vehicle for a velocity; it acts in the first step at or after its stamp.

        Raises
        ------
        KeyError
            when there is no such vehicle.
        ValueError
            when a velocity is not finite, or commands from the future pile up.
        """
        self._vehicles[vehicle_name].drive.command(command)

    def step(self) -> None:
        """Go on by one tick."""
        for vehicle in self._vehicles.values():
            vehicle.act(self.sim_nanos)
        self._engine.stepSimulation()
        self.tick += 1
        for vehicle in self._vehicles.values():
            vehicle.sense()

    def vehicle_states(self) -> dict[str, VehicleState]:
        """Return the truth about every vehicle at the present tick, by name."""
        return {name: vehicle.state() for name, vehicle in self._vehicles.items()}

    def motor_torques(self, vehicle_name: str) -> memoryview:
        """Return the torque of each wheel's motor in the last tick: float64, N m, forward > 0."""
        return self._vehicles[vehicle_name].motor_torques()

    def vitals(self, stamp_nanos: int) -> list[Vitals]:
        """Return every vehicle's energy so far and what it has touched since the last call."""
        return [
            Vitals(
                stamp_nanos,
                name,
                self.tick,
                vehicle.ledger.motor_work_j,
                vehicle.ledger.braked_j,
                vehicle.ledger.contacts(self._bodies),
            )
            for name, vehicle in self._vehicles.items()
        ]
