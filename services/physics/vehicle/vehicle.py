# SPDX-License-Identifier: Apache-2.0
"""One vehicle in the backend: its body, springs, running gear and joints.

States are in the frames of the model (the base link's origin, not the center of mass) and in the
model's order of links and wheels.
"""

from collections.abc import Callable, Mapping, Sequence
from math import cos, sin
from struct import Struct
from typing import NamedTuple

import numpy as np

from groundlink.core.clock import TICK_NANOS
from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.quaternions import multiply
from groundlink.messages.base import VehicleState, packed
from groundlink.messages.navigation import JointState
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.vehicle import Bumper, VehicleModel
from groundlink.scene.spawn_pose import spawn_pose
from groundlink.world.mesh_asset import load_mesh
from groundlink.world.roughness import RoughGround
from groundlink.world.solids import Mesh, Solid
from groundlink.world.terrain import Ground
from services.physics.dynamics.backend import (
    CHASSIS,
    GRAVITY_MPS2,
    WHEEL,
    Backend,
    Pose,
    Surface,
    Twist,
)
from services.physics.dynamics.energy_and_contacts import EnergyAndContacts
from services.physics.dynamics.memory import PartWithMemory, numbers_of, set_numbers

from .body_drag import body_drag
from .controller import Controller
from .joint_commands import JointCommandReader
from .memory import VehicleMemory
from .ride import EngineShake, Ride, RoughnessAt, no_roughness
from .running_gear import GroundContact, RunningGear
from .servos import Servos
from .urdf import convex_hull, hull_file, suspension_joint, urdf

BOX_POINTS = 4
"""Points at which a side of a box touches a wall; how many touch is known after the first tick."""

Friction = Callable[[int, Vector3], float]
"""Coefficient of friction of the ground, by its body and a point in the world."""


class RestState(NamedTuple):
    """A vehicle at rest, to put another vehicle of its model into the same state."""

    center_m: Vector3
    """Center of mass in the world."""

    orientation: Quaternion
    springs_m: tuple[float, ...]
    """Positions of the wheels along the base's z."""

    treads_m: tuple[tuple[float, float], ...]
    """Deflections of the tires, forward and to the left."""

    contacts: list[GroundContact | None]


class SimulatedVehicle:
    """A vehicle, at first standing on its springs at its placement.

    Parameters
    ----------
    friction
        of the ground under wheels.
    ground
        the terrain at its placement; None: flat ground.
    rough, roughness_at
        heights of rough ground, and where ground is rough; None: all is smooth.
    epoch_nanos
        stamp of sim time zero.
    """

    def __init__(
        self,
        backend: Backend,
        vehicle: Vehicle,
        friction: Friction,
        *,
        ground: Ground | None = None,
        rough: RoughGround | None = None,
        roughness_at: RoughnessAt = no_roughness,
        epoch_nanos: int = 0,
    ) -> None:
        self._backend = backend
        self._model = model = vehicle.model.with_effects(vehicle.effects)
        self._friction = friction
        self.drive = Controller(model, epoch_nanos=epoch_nanos)
        self.servos = Servos(model.joints, epoch_nanos=epoch_nanos)
        self._joint_commands = JointCommandReader(model)
        self.energy_and_contacts = EnergyAndContacts()
        collisions = (part.shape for part in model.collisions)
        hulls = {
            hull_file(mesh): convex_hull(load_mesh(mesh.asset).vertices)
            for mesh in collisions
            if isinstance(mesh, Mesh)
        }
        self.body, joints = backend.add_articulated(urdf(model), hulls, spawn_pose(vehicle, ground))
        self._joints = [joints[suspension_joint(wheel)] for wheel in model.wheels]
        self._place = {joint: place for place, joint in enumerate(self._joints)}
        self._count = count = len(model.wheels)
        preloads = _preloads(model)
        springs = [wheel.suspension or model.suspension for wheel in model.wheels]
        self._springs = [
            (preload, spring.stiffness_npm, spring.damping_nspm)
            for preload, spring in zip(preloads, springs, strict=True)
        ]
        whole_kg = model.chassis.mass_kg + sum(wheel.mass_kg for wheel in model.wheels)
        self.running_gear = RunningGear(
            model,
            # A wheel held in the air counts with an equal share of the whole mass.
            [
                preload / GRAVITY_MPS2 + wheel.mass_kg if preload > 0.0 else whole_kg / count
                for preload, wheel in zip(preloads, model.wheels, strict=True)
            ],
        )
        self._com = model.chassis.center_m
        self._centers = [wheel.center_m for wheel in model.wheels]
        self._body_drag = body_drag(model)
        tread, engine = (v.tread, v.engine) if (v := model.vibration) else (None, None)
        self._ride = (
            Ride(self.running_gear.wheels, rough, roughness_at, tread) if rough or tread else None
        )
        self._engine_shake = (
            EngineShake(engine, mass_kg=whole_kg, top_speed_mps=model.top_speed_mps)
            if engine
            else None
        )
        self._pack_links = Struct(f"<{7 * (count + 1 + len(model.joints))}d").pack
        self._pack_wheels = Struct(f"<{count}d").pack
        self._pack_velocity = Struct("<6d").pack
        self._set_surfaces()
        self._bumper_points = 0
        if model.bumper:
            self._share_bumper(model.bumper, BOX_POINTS)
        self._first_contacts: list[GroundContact | None] | None = None
        self.sense()

    def _set_surfaces(self) -> None:
        chassis = self._model.chassis
        surface = Surface(chassis.friction, chassis.restitution, CHASSIS)
        self._backend.set_surface(self.body, surface)
        for wheel, link in zip(self._model.wheels, self._joints, strict=True):
            # The tire model makes the grip; the backend's contact only carries.
            self._backend.set_surface(self.body, Surface(0.0, wheel.restitution, WHEEL), link)

    def _share_bumper(self, bumper: Bumper, points: int) -> None:
        """Give each of a number of contact points its share of the bumper."""
        if points != self._bumper_points:
            self._bumper_points = points
            self._backend.set_contact_spring(
                self.body, bumper.stiffness_npm / points, bumper.damping_nspm / points
            )

    def sense(self) -> None:
        """Read position and velocity of the base and the springs from the backend."""
        backend, body = self._backend, self.body
        self._sprung = backend.joint_states(body, self._joints)
        center, self._quaternion = backend.pose(body)
        velocity, self._turn = backend.velocity(body)
        # From the center of mass to the base link's origin.
        self._rows = rows = _matrix(self._quaternion)
        (a, b, c), (d, e, f), (g, h, i) = rows
        cx, cy, cz = self._com
        dx = -(a * cx + b * cy + c * cz)
        dy = -(d * cx + e * cy + f * cz)
        dz = -(g * cx + h * cy + i * cz)
        wx, wy, wz = self._turn
        self._origin = center[0] + dx, center[1] + dy, center[2] + dz
        self._velocity = (
            velocity[0] + wy * dz - wz * dy,
            velocity[1] + wz * dx - wx * dz,
            velocity[2] + wx * dy - wy * dx,
        )

    @property
    def fastest(self) -> float:
        """The largest component of its velocities: m/s, rad/s, and m/s of springs."""
        return float(max(map(abs, (*self._velocity, *self._turn, *(s[1] for s in self._sprung)))))

    def stop(self) -> None:
        """Take all velocities away."""
        zero = (0.0, 0.0, 0.0)
        self._backend.set_velocity(self.body, zero, zero)
        still = [(position, 0.0) for position, *_ in self._sprung]
        self._backend.set_joint_states(self.body, self._joints, still)
        self.sense()

    def at_rest(self) -> RestState:
        """Return its present state with all velocities zero."""
        return RestState(
            self._backend.pose(self.body)[0],
            self._quaternion,
            tuple(position for position, *_ in self._sprung),
            tuple(wheel.tire.deflection_m for wheel in self.running_gear.wheels),
            self._ground_contacts(0),
        )

    def put(self, rest: RestState) -> None:
        """Set its state to the rest of another vehicle of its model, before the first step."""
        self._backend.set_pose(self.body, (rest.center_m, rest.orientation))
        still = [(position, 0.0) for position in rest.springs_m]
        self._backend.set_joint_states(self.body, self._joints, still)
        for wheel, deflection in zip(self.running_gear.wheels, rest.treads_m, strict=True):
            wheel.tire.deflection_m = deflection
        self._first_contacts = rest.contacts
        self.sense()

    def memory(self, tick: int, bodies: Mapping[int, Sequence[Solid]]) -> VehicleMemory:
        """Return all that the next tick depends on; the vehicle then takes no more ticks.

        Parameters
        ----------
        bodies
            solids of each body.
        """
        backend = self._backend
        contacts = self._ground_contacts(tick)
        return VehicleMemory(
            pose=backend.pose(self.body),
            twist=backend.velocity(self.body),
            springs=tuple((position, velocity) for position, velocity, *_ in self._sprung),
            ground_contacts=tuple(contacts),
            roughness_under=tuple(self._ride.under) if self._ride else (),
            bumper_points=self._bumper_points,
            contacts=self.energy_and_contacts.named(bodies),
            drive=self.drive.memory(),
            servos=self.servos.memory(),
            numbers=numbers_of(self._parts()),
        )

    def remember(self, memory: VehicleMemory) -> None:
        """Continue where another vehicle of its model stopped.

        Raises
        ------
        ValueError
            when it was another model.
        """
        if len(memory.ground_contacts) != self._count:
            raise ValueError(f"expected {self._count} wheels, got {len(memory.ground_contacts)}")
        self._backend.set_pose(self.body, memory.pose)
        self._backend.set_joint_states(self.body, self._joints, memory.springs)
        self._backend.set_velocity(self.body, *memory.twist)
        self._first_contacts = list(memory.ground_contacts)
        if self._ride:
            self._ride.under = list(memory.roughness_under)
        if self._model.bumper:
            self._share_bumper(self._model.bumper, memory.bumper_points)
        self.energy_and_contacts.remember(memory.contacts)
        self.drive.remember(memory.drive)
        self.servos.remember(memory.servos)
        set_numbers(self._parts(), memory.numbers)
        self.sense()

    def _parts(self) -> list[PartWithMemory]:
        """Return the parts whose inner state is numbers."""
        lifts = self._ride.lifts if self._ride else []
        shake = [self._engine_shake] if self._engine_shake else []
        steering, gear = self.drive.steering, self.running_gear.parts()
        return [self.energy_and_contacts, steering, *gear, *lifts, *shake]

    def place(self, pose: Pose | None, twist: Twist | None) -> None:
        """Set pose or velocity of the base's origin; None: unchanged.

        With a new pose its springs are as at the start, and its wheels touch the ground from the
        next step on; with a new velocity they roll along.
        """
        (x, y, z), orientation = pose or self.pose()
        (vx, vy, vz), (wx, wy, wz) = twist or self.twist()
        cx, cy, cz = self._com
        (a, b, c), (d, e, f), (g, h, i) = _matrix(orientation)
        # From the base link's origin to the center of mass.
        dx, dy, dz = a * cx + b * cy + c * cz, d * cx + e * cy + f * cz, g * cx + h * cy + i * cz
        if pose is not None:
            self._backend.set_pose(self.body, ((x + dx, y + dy, z + dz), orientation))
            self._backend.set_joint_states(self.body, self._joints, [(0.0, 0.0)] * self._count)
            self._first_contacts = [None] * self._count
        # A new pose has taken the velocity away.
        velocity = vx + wy * dz - wz * dy, vy + wz * dx - wx * dz, vz + wx * dy - wy * dx
        self._backend.set_velocity(self.body, velocity, (wx, wy, wz))
        if twist is not None:
            forward_mps, turn_radps = a * vx + d * vy + g * vz, c * wx + f * wy + i * wz
            self.running_gear.roll(forward_mps, turn_radps)
        self.sense()

    def pose(self) -> Pose:
        """Return world_from_base."""
        return self._origin, self._quaternion

    def twist(self) -> Twist:
        """Return the velocity of the base's origin in the world."""
        return self._velocity, self._turn

    @property
    def position_m(self) -> Vector3:
        """The base's origin in the world."""
        return self._origin

    def act(self, sim_nanos: int) -> None:
        """Apply the forces of springs, tires and motors for the step from `sim_nanos`."""
        running_gear = self.running_gear
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        (vx, vy, vz), (wx, wy, wz) = self._velocity, self._turn
        vx, vy, vz = a * vx + d * vy + g * vz, b * vx + e * vy + h * vz, c * vx + f * vy + i * vz
        turn = a * wx + d * wy + g * wz, b * wx + e * wy + h * wz, c * wx + f * wy + i * wz
        (x, y, z), torque, along_springs = running_gear.go(
            self.drive.wheels(sim_nanos, running_gear.angles()),
            velocity=(vx, vy, vz),
            turn=turn,
            springs=self._sprung,
            contacts=self._ground_contacts(sim_nanos // TICK_NANOS),
        )
        self.servos.step(sim_nanos)
        self.energy_and_contacts.worked(running_gear.driving_w, running_gear.braking_w)
        if self._engine_shake:
            z += self._engine_shake.force_n(vx)
        if self._body_drag:
            (x, y, z), torque = self._body_drag.slow((x, y, z), torque, (vx, vy, vz), turn)
        self._backend.push(self.body, (x, y, z), torque)
        sprung = self._ride.springs(self._sprung, self._hubs()) if self._ride else self._sprung
        # Along the base's z on the wheel; a spring pushes it down by the load that rests on it.
        self._backend.set_joint_forces(
            self.body,
            self._joints,
            [
                force - preload - stiffness * spring[0] - damping * spring[1]
                for force, (preload, stiffness, damping), spring in zip(
                    along_springs, self._springs, sprung, strict=True
                )
            ],
        )

    def _hubs(self) -> list[tuple[float, float]]:
        """Return the places of the wheels in the world, x and y."""
        (a, b, c), (d, e, f), _ = self._rows
        ox, oy, _ = self._origin
        return [
            (ox + a * x + b * y + c * z, oy + d * x + e * y + f * z) for x, y, z in self._centers
        ]

    def _ground_contacts(self, tick: int) -> list[GroundContact | None]:
        """Return each wheel's contact in the last step; record those of the chassis."""
        if (first := self._first_contacts) is not None:
            self._first_contacts = None
            return first
        contacts: list[GroundContact | None] = [None] * self._count
        touching = 0
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        for other, link, point, (x, y, z), force in self._backend.contacts(self.body):
            if (place := self._place.get(link)) is None:
                self.energy_and_contacts.touched((tick, other, point, force))
                touching += 1
                continue
            grip = self._friction(other, point) * force
            if self._ride:
                self._ride.touch(place, other, point)
            x, y, z = x * force, y * force, z * force
            x, y, z = a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z
            if (before := contacts[place]) is not None:
                grip, x, y, z = grip + before[0], x + before[1], y + before[2], z + before[3]
            contacts[place] = grip, x, y, z
        if touching and self._model.bumper:
            self._share_bumper(self._model.bumper, touching)
        return contacts

    def command_joints(self, command: JointState) -> bool:
        """Command joints by name; see `JointCommandReader`.

        Returns
        -------
        False for a command of the drive that is stale.

        Raises
        ------
        ValueError
            when the command is invalid.
        """
        targets, servos = self._joint_commands.read(command)
        if servos is not None:
            self.servos.command(servos)
        return not any(targets) or self.drive.command_joints(command.stamp_nanos, targets)

    def steering(self) -> tuple[memoryview, memoryview]:
        """Return angles and speeds of the steering joints after the last step, float64."""
        gear = self.running_gear
        return packed(np.array(gear.angles())), packed(np.array(gear.steering_speeds()))

    def motor_torques(self) -> memoryview:
        """Return the motor's torque on each wheel's axle in the last step: float64, N m."""
        return memoryview(
            self._pack_wheels(*[wheel.torque_nm for wheel in self.running_gear.wheels])
        )

    def state(self) -> VehicleState:
        """Return the state after the last step."""
        x, y, z = self._origin
        qx, qy, qz, qw = self._quaternion
        poses = [x, y, z, qx, qy, qz, qw]
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        wheels = self.running_gear.wheels
        for (cx, cy, cz), spring, wheel in zip(self._centers, self._sprung, wheels, strict=True):
            cz += spring[0]
            angle = wheel.angle_rad / 2
            sine, cosine = sin(angle), cos(angle)
            ux, uy, uz, uw = qx, qy, qz, qw
            if wheel.steering_joint:
                # A steered wheel is turned about z first.
                half = wheel.steering_joint.angle_rad / 2
                s, k = sin(half), cos(half)
                ux, uy, uz, uw = qx * k + qy * s, qy * k - qx * s, qz * k + qw * s, qw * k - qz * s
            poses += (
                x + a * cx + b * cy + c * cz,
                y + d * cx + e * cy + f * cz,
                z + g * cx + h * cy + i * cz,
                # A turn about y: (0, sine, 0, cosine).
                ux * cosine - uz * sine,
                uy * cosine + uw * sine,
                uz * cosine + ux * sine,
                uw * cosine - uy * sine,
            )
        for (cx, cy, cz), turn in self.servos.poses:
            poses += (
                x + a * cx + b * cy + c * cz,
                y + d * cx + e * cy + f * cz,
                z + g * cx + h * cy + i * cz,
                *multiply(self._quaternion, turn),
            )
        return VehicleState(
            memoryview(self._pack_links(*poses)),
            memoryview(self._pack_velocity(*self._velocity, *self._turn)),
            memoryview(self._pack_wheels(*[wheel.angle_rad for wheel in wheels])),
            memoryview(self._pack_wheels(*[wheel.speed_radps for wheel in wheels])),
            *self.servos.state,
        )


def _matrix(quaternion: Quaternion) -> tuple[Vector3, Vector3, Vector3]:
    """Return the rows of a unit quaternion's matrix, ten times as fast as numpy does."""
    x, y, z, w = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


def _preloads(model: VehicleModel) -> list[float]:
    """Return the force (N) with which each spring carries the chassis at rest.

    Forces and their moments balance the weight of the chassis and of wheels in the air. Of all such
    loads, the one with the smallest sum of squares: that of springs of one stiffness. The springs
    of wheels in the air hold these up, so their force is negative.
    """
    standing = np.array([model.stands_on(wheel) for wheel in model.wheels])
    places = np.array([(1.0, *wheel.center_m[:2]) for wheel in model.wheels]).T
    hanging = np.where(standing, 0.0, [wheel.mass_kg for wheel in model.wheels])
    x, y, _ = model.chassis.center_m
    weights = GRAVITY_MPS2 * (model.chassis.mass_kg * np.array([1.0, x, y]) + places @ hanging)
    loads = np.linalg.lstsq(places * standing, weights)[0] - GRAVITY_MPS2 * hanging
    preloads: list[float] = loads.tolist()
    return preloads
