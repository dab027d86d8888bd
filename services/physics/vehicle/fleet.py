# SPDX-License-Identifier: Apache-2.0
"""Fleet: the vehicles of a simulation, stepped together.

A tick goes from commands to forces in the stages of `Fleet.act`. Each stage is one call for all
vehicles; `vehicle.c` has those that compute.
"""

from collections.abc import Mapping
from ctypes import byref

from msgspec import msgpack

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import VehicleState
from services.physics.dynamics.backend import Backend
from services.physics.dynamics.bodies import BodyList, pointers
from services.physics.dynamics.ground import GroundTable
from services.physics.dynamics.kernels import kernels
from services.physics.soil.ruts import PressedRuts

from .vehicle import SimulatedVehicle


class Fleet:
    """Some vehicles in one backend, by their names.

    Parameters
    ----------
    ground
        under their wheels.
    ruts
        of soft terrain; None: there is none.
    """

    def __init__(
        self,
        backend: Backend,
        vehicles: Mapping[str, SimulatedVehicle],
        ground: GroundTable,
        ruts: PressedRuts | None = None,
    ) -> None:
        self._backend, self._ground, self._ruts = backend, ground, ruts
        self._vehicles = list(vehicles.values())
        self._riding = [vehicle for vehicle in self._vehicles if vehicle.ride]
        self._by_body = {vehicle.body: vehicle for vehicle in self._vehicles}
        self._bodies = BodyList([vehicle.articulated for vehicle in self._vehicles])
        self._all = pointers(self._vehicles), len(self._vehicles)
        # The states, encoded once. C writes the numbers of each tick to their places.
        self._states = bytearray(
            msgpack.encode({name: vehicle.blank_state() for name, vehicle in vehicles.items()})
        )
        placed = msgpack.decode(self._states, type=dict[str, VehicleState])
        for name, vehicle in vehicles.items():
            vehicle.write_to(placed[name])

    def act(self, tick: int) -> None:
        """Apply the forces of motors, tires, air and springs for the step from a tick."""
        compiled = kernels()
        for vehicle in self._vehicles:
            vehicle.follow_commands(tick * TICK_NANOS)
        self.touch(tick)
        if self._ruts is not None:
            compiled.vehicles_press(*self._all, byref(self._ruts))
        compiled.vehicles_roll(*self._all)
        for vehicle in self._riding:
            vehicle.follow_roughness()
        compiled.vehicles_spring(*self._all)
        self._backend.push(self._bodies)

    def touch(self, tick: int) -> None:
        """Give each wheel its contact in the last step; record those of chassis."""
        contacts = self._backend.contacts()
        count = kernels().vehicles_touch(*self._all, byref(contacts), byref(self._ground))
        if not count:
            return
        of_chassis = contacts.points[:count]
        for body in dict.fromkeys(contact.body for contact in of_chassis):
            its = [contact for contact in of_chassis if contact.body == body]
            self._by_body[body].touched(tick, its)

    def sense(self) -> None:
        """Read the motion of all vehicles from the backend."""
        self._backend.sense(self._bodies)
        kernels().vehicles_sense(*self._all)

    def states(self) -> bytes:
        """Return the states after the last step, as `State.vehicles` is encoded."""
        kernels().vehicles_write(*self._all)
        return bytes(self._states)
