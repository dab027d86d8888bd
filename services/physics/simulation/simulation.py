# SPDX-License-Identifier: Apache-2.0
"""The physics of a run: a world, its vehicles and its actors, stepped tick by tick.

The same calls give the same bytes. Nothing here reads a clock or knows how fast time should pass.
"""

import struct
from collections.abc import Callable, Mapping, Sequence, Set
from contextlib import closing
from typing import Self

import numpy as np
from msgspec import UNSET, Struct, msgpack
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Command, VehicleState, WheelCommand
from groundlink.messages.ground_truth import Vitals
from groundlink.messages.navigation import JointState
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.vehicle import Towing, VehicleModel
from groundlink.scene.spawn_checks import actor_bodies, vehicle_bodies
from groundlink.world import terrain
from groundlink.world.actors import Actor
from groundlink.world.roughness import RoughGround, roughness_of
from groundlink.world.solids import Material, Solid, Sphere
from groundlink.world.terrain import Ground
from services.physics.dynamics.backend import Backend, Pose, Twist
from services.physics.dynamics.bullet import BulletBackend
from services.physics.dynamics.ground import GroundTable, soils_of
from services.physics.dynamics.statics import StaticBody, add_statics
from services.physics.dynamics.terrain import CarriedBody, NoTerrain, TerrainWindows, reach_of
from services.physics.soil.ruts import PressedRuts, RutMemory
from services.physics.vehicle.fleet import Fleet
from services.physics.vehicle.memory import VehicleMemory
from services.physics.vehicle.vehicle import RestState, SimulatedVehicle

from . import actors


class SimulationMemory(Struct, frozen=True, array_like=True):
    """Inner state of a `Simulation` between two ticks; scripted actors follow from the tick."""

    tick: int
    vehicles: dict[str, VehicleMemory]
    free_actors: dict[str, tuple[Pose, Twist]]
    """Of their origins."""

    ruts: RutMemory | None = None
    """None without soft terrain."""

    def stamped_before_tick(self) -> "SimulationMemory":
        """Return it without commands that act from its tick on: a journal has them."""
        nanos = self.tick * TICK_NANOS
        vehicles = {name: v.stamped_before(nanos) for name, v in self.vehicles.items()}
        return replace(self, vehicles=vehicles)


NOTHING_KNOWN = SimulationMemory(0, {}, {})
"""Of a simulation at tick zero."""


class Simulation:
    """A world at tick zero with every vehicle standing still.

    Parameters
    ----------
    scenario
        gives materials, vehicles and actors.
    solids
        all static solids of the world, in the world's frame.
    epoch_nanos
        stamp of sim time zero in commands.
    new_backend
        makes the physics engine's world.
    memory
        of a simulation of the same scenario, to continue from; None: tick zero.

    Attributes
    ----------
    ruts
        of its terrain; None without soft terrain.
    is_as_built
        whether its bodies are those that another simulation of the present scenario would have.
    """

    def __init__(
        self,
        scenario: Scenario,
        solids: Sequence[Solid],
        *,
        epoch_nanos: int = 0,
        new_backend: Callable[[], Backend] = BulletBackend,
        memory: SimulationMemory | None = None,
    ) -> None:
        self._known = memory or NOTHING_KNOWN
        self.tick = self._known.tick
        self._new_backend = new_backend
        self._backend = new_backend()
        self._epoch_nanos = epoch_nanos
        # Wheels must roll over what every chassis passes over, or nothing would touch it.
        self._clearance_m = min(
            (
                model.base_height_m + model.chassis.center_m[2] - model.chassis.size_m[2] / 2
                for model in (vehicle.model for vehicle in scenario.vehicles)
            ),
            default=0.0,
        )
        mapped, materials = scenario.world.terrain, scenario.world.materials
        self._materials = materials
        self._roughness = roughness_of(scenario.world.roughness)
        self._rough = RoughGround(scenario.seed) if scenario.world.roughness else None
        self._terrain: TerrainWindows | NoTerrain = (
            TerrainWindows(self._backend, terrain.load_ground(mapped), materials, self._roughness)
            if mapped
            else NoTerrain()
        )
        self._water = scenario.world.water
        self._soils = soils_of(materials)
        self._ground = GroundTable(self._terrain, self._soils)
        self.ruts: PressedRuts | None = None
        if mapped and self._terrain.ground and mapped.is_soft(materials):
            self.ruts = PressedRuts(self._terrain.ground, self._known.ruts)
        self._statics: dict[int, StaticBody] = {}
        self._vehicles: dict[str, SimulatedVehicle] = {}
        self._models: dict[str, VehicleModel] = {}
        self._hitches: dict[str, Towing] = {}
        """Of the towed vehicles."""

        self._ball_joints: list[int] = []
        self._actors: dict[str, actors.ScriptedActor | actors.FreeActor] = {}
        self._described: dict[str, Actor] = {}
        self._bodies: dict[int, Sequence[Solid]] = {}
        """Solids of each body, also of removed ones: they may have been touched before."""

        self.become(scenario, solids)
        self._known = NOTHING_KNOWN
        self.is_as_built = True

    def memory(self) -> SimulationMemory:
        """Return all that the next tick depends on; the simulation then takes no more steps.

        What the engine knows besides (which points touched in the last step) is not part of it. So
        a simulation that continues from it is equal only to another one that does.
        """
        self._fleet.touch(self.tick)
        free = {n: a for n, a in self._actors.items() if isinstance(a, actors.FreeActor)}
        return SimulationMemory(
            self.tick,
            {name: v.memory(self._bodies) for name, v in self._vehicles.items()},
            {name: (actor.pose(), actor.twist()) for name, actor in free.items()},
            None if self.ruts is None else self.ruts.memory(),
        )

    def continue_from(self, memory: SimulationMemory, scenario: Scenario) -> None:
        """Continue from its own memory as a simulation would that is built with it.

        All that moves is built again, in the same order, and static bodies stay: a world of many
        solids or large meshes takes longer to build.

        Parameters
        ----------
        scenario
            the present one; `is_as_built` must be true.
        """
        self._known = memory
        self._uncouple()
        # The engine swaps the last body into the place of a removed one.
        for put in reversed(self._actors.values()):
            self._remove(put)
        for vehicle in reversed(self._vehicles.values()):
            self._remove(vehicle)
        self._actors.clear()
        self._vehicles.clear()
        for described in scenario.vehicles:
            self._put_vehicle(described)
        for actor in scenario.world.actors:
            self._put_actor(actor, self._materials)
        self._known = NOTHING_KNOWN
        self._assemble()

    def become(self, scenario: Scenario, solids: Sequence[Solid]) -> None:
        """Remove what a scenario lacks and add what is new in it; all else continues.

        Things are identified by name; a solid that has moved is a new one. New things start as they
        do at tick zero, vehicles at their placements.
        """
        self.is_as_built = False
        self._uncouple()
        self._remove_others(
            {vehicle.name for vehicle in scenario.vehicles},
            {actor.name for actor in scenario.world.actors},
            {solid.name: solid for solid in solids},
        )
        materials = scenario.world.materials
        there = {solid.name for static in self._statics.values() for solid in static.solids}
        statics = add_statics(
            self._backend,
            [solid for solid in solids if solid.name not in there],
            materials,
            clearance_m=self._clearance_m,
            roughness=self._roughness,
            lowest_m=self._terrain.lowest_m,
        )
        self._statics |= statics
        for body, static in statics.items():
            self._ground.add(body, static)
        self._bodies |= {body: static.solids for body, static in statics.items()}
        for described in scenario.vehicles:
            if described.name not in self._vehicles:
                self._put_vehicle(described)
        for actor in scenario.world.actors:
            if actor.name not in self._actors:
                self._put_actor(actor, materials)
        # States have actors in the scenario's order.
        self._actors = {a.name: self._actors[a.name] for a in scenario.world.actors}
        self._assemble()

    def _assemble(self) -> None:
        """Step the present vehicles from now on, and those that are towed at their hitches."""
        for name, hitch in self._hitches.items():
            if name in self._vehicles and hitch.vehicle in self._vehicles:
                by, it = self._vehicles[hitch.vehicle], self._vehicles[name]
                ends = by.body, by.from_center(hitch.hitch_m), it.body
                self._ball_joints.append(
                    self._backend.couple(*ends, it.from_center(hitch.coupling_m))
                )
        self._fleet = Fleet(self._backend, self._vehicles, self._ground, self.ruts)

    def _uncouple(self) -> None:
        """Open all hitches, until `_assemble`."""
        for joint in self._ball_joints:
            self._backend.uncouple(joint)
        self._ball_joints.clear()

    def _remove_others(
        self, vehicles: Set[str], actors: Set[str], solids: Mapping[str, Solid]
    ) -> None:
        """Remove all but those that are named, and solids that have moved."""
        for name in self._vehicles.keys() - vehicles:
            self._remove(self._vehicles.pop(name))
        for name in self._actors.keys() - actors:
            self._remove(self._actors.pop(name))
        for body, static in list(self._statics.items()):
            # A body stands for several solids: those that stay get a new one.
            if any(solids.get(solid.name) != solid for solid in static.solids):
                self._backend.remove(body)
                self._ground.remove(body)
                del self._statics[body]

    def _remove(self, carried: CarriedBody) -> None:
        self._terrain.drop(carried)
        self._backend.remove(carried.body)

    def _put_vehicle(self, described: Vehicle) -> None:
        vehicle = SimulatedVehicle(
            self._backend,
            described,
            ground=self._terrain.ground,
            soils=self._soils,
            rough=self._rough,
            water=self._water,
            epoch_nanos=self._epoch_nanos,
        )
        if (known := self._known.vehicles.get(described.name)) is not None:
            vehicle.remember(known)
        # A towed vehicle stands on its hitch, too, and finds its rest there.
        elif not described.towed_by and (self._terrain.ground or described.payload):
            ground = self._terrain.ground
            on, materials = (ground, self._materials) if ground else (LEVEL, ON_LEVEL)
            if (rest := settled(described, on, materials, self._new_backend)) is not None:
                vehicle.put(rest)
        self._vehicles[described.name] = vehicle
        self._models[described.name] = described.model
        if described.towed_by:
            self._hitches[described.name] = described.towed_by
        self._bodies[vehicle.body] = (_whole(described.name),)
        self._carry(vehicle, described.model.name, reach_of(described.model))

    def _put_actor(self, actor: Actor, materials: Mapping[str, Material]) -> None:
        put = actors.put(self._backend, actor, self._terrain.ground, materials, self.tick)
        self._actors[actor.name] = put
        self._described[actor.name] = actor
        self._bodies[put.body] = (_whole(actor.name),)
        if isinstance(put, actors.FreeActor):
            if (known := self._known.free_actors.get(actor.name)) is not None:
                put.place(*known)
            self._carry(put, actor.name, put.reach_m)

    def _carry(self, carried: CarriedBody, name: str, reach_m: float) -> None:
        """Keep terrain under a body, if there is terrain."""
        if (window := self._terrain.carry(carried, name, reach_m)) is not None:
            self._bodies[window] = (_whole(terrain.BODY),)

    def reset_state(self, scenario: Scenario) -> None:
        """Put all vehicles and free actors of the present scenario back where they begin.

        Ruts vanish.
        """
        self.is_as_built = False
        self._uncouple()
        if self.ruts is not None:
            self.ruts.clear()
        for described in scenario.vehicles:
            self._remove(self._vehicles.pop(described.name))
            self._put_vehicle(described)
        self._assemble()
        for actor in scenario.world.actors:
            if isinstance(put := self._actors[actor.name], actors.FreeActor):
                self._remove(put)
                self._put_actor(actor, self._materials)

    def place(self, name: str, pose: Pose | None, twist: Twist | None) -> None:
        """Set pose or velocity of a vehicle or a free actor; None: unchanged.

        Raises
        ------
        KeyError
            when there is neither of this name.
        """
        free = self._actors.get(name)
        placed = free if isinstance(free, actors.FreeActor) else self._vehicles[name]
        placed.place(pose, twist)

    def motions(self) -> dict[str, tuple[Pose, Twist]]:
        """Return poses and velocities of all vehicles and actors, of their origins, in world."""
        bodies = {**self._vehicles, **self._actors}
        return {name: (body.pose(), body.twist()) for name, body in bodies.items()}

    def moving(self) -> list[Solid]:
        """Return the bodies of vehicles and actors where they are now, in the world frame."""
        found = []
        for name, vehicle in self._vehicles.items():
            found += vehicle_bodies(name, self._models[name], *vehicle.pose())
        for name, actor in self._actors.items():
            found += actor_bodies(self._described[name], *actor.pose())
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the backend; call nothing else after it."""
        self._backend.close()

    @property
    def sim_nanos(self) -> int:
        """Sim time of the present tick."""
        return self.tick * TICK_NANOS

    def command(self, vehicle_name: str, command: Command | WheelCommand | JointState) -> bool:
        """Command velocities of a vehicle or its wheels, or its joints by name.

        A command acts in the first step at or after its stamp.

        Returns
        -------
        False for a stale command, which does not act.

        Raises
        ------
        KeyError
            when there is no such vehicle.
        ValueError
            when a velocity is not finite, or commands from the future pile up.
        """
        vehicle = self._vehicles[vehicle_name]
        if isinstance(command, JointState):
            return vehicle.command_joints(command)
        return vehicle.drive.command(command)

    def step(self) -> None:
        """Advance by one tick."""
        self._fleet.act(self.tick)
        for actor in self._actors.values():
            actor.act(self.tick)
        self._terrain.follow()
        self._backend.step()
        self.tick += 1
        self._fleet.sense()

    def encoded_states(self) -> bytes:
        """Return the truth about every vehicle at the present tick, as messages have it."""
        return self._fleet.states()

    def vehicle_states(self) -> dict[str, VehicleState]:
        """Return the truth about every vehicle at the present tick, by name."""
        return msgpack.decode(self.encoded_states(), type=dict[str, VehicleState])

    def actor_poses(self) -> memoryview:
        """Return world_from_actor of every actor, as `State.actors` has it."""
        if not self._actors:
            return memoryview(b"")
        poses = [actor.pose() for actor in self._actors.values()]
        return memoryview(b"".join([_pack_row(*position, *turn) for position, turn in poses]))

    def motor_torques(self, vehicle_name: str) -> memoryview:
        """Return the torque of each wheel's motor in the last tick: float64, N m, forward > 0."""
        return self._vehicles[vehicle_name].motor_torques()

    def steering(self, vehicle_name: str) -> tuple[memoryview, memoryview]:
        """Return angles and speeds of a vehicle's steering joints: float64, rad and rad/s."""
        return self._vehicles[vehicle_name].steering()

    def vitals(self, stamp_nanos: int) -> list[Vitals]:
        """Return every vehicle's energy so far and its contacts since the last call."""
        return [
            Vitals(
                stamp_nanos,
                name,
                self.tick,
                vehicle.running_gear.work.driven_j,
                vehicle.running_gear.work.braked_j,
                vehicle.contacts.report(self._bodies),
                vehicle.running_gear.battery(),
                vehicle.wheels_in_soil() or UNSET,
                (vehicle.water and vehicle.water.report()) or UNSET,
            )
            for name, vehicle in self._vehicles.items()
        ]


_pack_row = struct.Struct("<7d").pack


def _whole(name: str) -> Solid:
    """Return a solid that stands for a moving body, whose contacts have one name."""
    return Solid(name, Sphere(radius_m=1.0), "")


LEVEL = Ground(np.zeros((2, 2), np.float32), np.zeros((1, 1), np.uint8), 1.0, 0.0, 0.0, ("level",))
"""Ground on which a payload presses the springs, where there is no terrain."""

ON_LEVEL = {"level": Material()}

MAX_TICKS = 2400
"""A vehicle that still moves after these is not at rest anywhere near."""

STILL_TICKS = 20
"""Longer than a swing stands still at its turning point."""

STILL = 5e-5
"""Velocity, m/s and rad/s, below which a vehicle is at rest."""


def settled(
    vehicle: Vehicle,
    ground: Ground,
    materials: Mapping[str, Material],
    new_backend: Callable[[], Backend] = BulletBackend,
) -> RestState | None:
    """Return how a vehicle rests on the terrain at its placement; None if it does not.

    Computed in a backend of its own with the terrain alone, so that nothing in the run moves. On
    flat ground springs start at their loaded rest, and without payload nothing is computed. A
    vehicle that slides, as on ice, or starts above the ground, starts where
    `groundlink.scene.spawn_pose` puts it.

    Effects do not act: a running engine never comes to rest. Wheels do not sink yet.

    Kinetic damping: all motion is taken away whenever it begins to slow down. Otherwise springs
    would swing beyond their rest, and a tall vehicle would tip over.
    """
    if vehicle.placement.z_m > 0:
        return None
    with closing(new_backend()) as backend:
        terrain = TerrainWindows(backend, ground, materials)
        it = SimulatedVehicle(backend, replace(vehicle, effects=()), ground=ground)
        fleet = Fleet(backend, {vehicle.name: it}, GroundTable(terrain, soils_of(materials)))
        terrain.carry(it, vehicle.model.name, reach_of(vehicle.model))
        still, fastest, rises = 0, 0.0, False
        for tick in range(MAX_TICKS):
            fleet.act(tick)
            terrain.follow()
            backend.step()
            fleet.sense()
            before, fastest = fastest, it.fastest
            if rises and fastest < before:
                it.stop()
            rises = fastest > before
            still = still + 1 if fastest < STILL else 0
            if still == STILL_TICKS:
                fleet.touch(tick)
                return it.at_rest()
    return None
