# SPDX-License-Identifier: Apache-2.0
"""One vehicle in the physics engine: its body, its springs, its motors, and where it all is.

Rule: what leaves this module is in the frames of the model (the base link's origin, not Bullet's
center of mass) and in the model's order of links and wheels.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from math import cos, sin
from pathlib import Path
from struct import Struct
from typing import NamedTuple

import numpy as np

from groundlink.core.clock import TICK_NANOS
from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.quaternions import multiply
from groundlink.messages.base import VehicleState
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.mesh_asset import surface
from groundlink.world.solids import Mesh
from groundlink.world.spawn_pose import start
from groundlink.world.terrain import Ground
from services.physics.dynamics.energy_and_contacts import EnergyAndContacts
from services.physics.dynamics.engine import GRAVITY_MPS2, Engine
from services.physics.dynamics.statics import CHASSIS, COLLIDES_WITH, WHEEL

from .body_drag import body_drag
from .controller import Controller
from .hull import hull
from .running_gear import RunningGear, Touch
from .servos import Servos
from .urdf import hull_file, suspension_joint, urdf

Friction = Callable[[int, Vector3], float]
"""Coefficient of the ground, by the engine's number of a body and a point in the world."""


class RestState(NamedTuple):
    """A vehicle at rest: what it takes to put another one of its model at the same place."""

    center_m: Vector3
    """Of mass, in the world."""

    orientation: Quaternion
    springs_m: tuple[float, ...]
    """Positions of the wheels along the base's z."""

    treads_m: tuple[tuple[float, float], ...]
    """Deflections of the tires, forward and to the left."""

    touches: list[Touch | None]


class SimulatedVehicle:
    """A vehicle that stands on its springs at its placement.

    Parameters
    ----------
    engine
        the world that it is put into.
    vehicle
        model and placement.
    friction
        of what wheels roll on.
    ground
        the terrain that it starts on; None: flat ground.
    epoch_nanos
        stamp of sim time zero.
    """

    def __init__(
        self,
        engine: Engine,
        vehicle: Vehicle,
        friction: Friction,
        *,
        ground: Ground | None = None,
        epoch_nanos: int = 0,
    ) -> None:
        self._engine = engine
        self._model = model = vehicle.model
        self._friction = friction
        self.drive = Controller(model, epoch_nanos=epoch_nanos)
        self.servos = Servos(model.joints, epoch_nanos=epoch_nanos)
        self.energy_and_contacts = EnergyAndContacts()
        self.body = body = _load(engine, vehicle, ground)
        indices = {
            engine.getJointInfo(body, joint)[1].decode(): joint
            for joint in range(engine.getNumJoints(body))
        }
        self._joints = [indices[suspension_joint(wheel)] for wheel in model.wheels]
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
            # A wheel that is held up bears what falls to each when it comes to it.
            [
                preload / GRAVITY_MPS2 + wheel.mass_kg if preload > 0.0 else whole_kg / count
                for preload, wheel in zip(preloads, model.wheels, strict=True)
            ],
        )
        self._com = model.chassis.center_m
        self._centers = [wheel.center_m for wheel in model.wheels]
        self._body_drag = body_drag(model)
        self._pack_links = Struct(f"<{7 * (count + 1 + len(model.joints))}d").pack
        self._pack_wheels = Struct(f"<{count}d").pack
        self._pack_velocity = Struct("<6d").pack
        self._set_dynamics()
        self._first_touches: list[Touch | None] | None = None
        self.sense()

    def _set_dynamics(self) -> None:
        engine, body, chassis = self._engine, self.body, self._model.chassis
        for link in range(-1, engine.getNumJoints(body)):
            # Bullet would damp every motion by 4 % a second; and what it damps more is not linear.
            engine.changeDynamics(body, link, linearDamping=0, angularDamping=0, jointDamping=0)
        engine.changeDynamics(
            body, -1, lateralFriction=chassis.friction, restitution=chassis.restitution
        )
        engine.setCollisionFilterGroupMask(body, -1, CHASSIS, COLLIDES_WITH[CHASSIS])
        for wheel, link in zip(self._model.wheels, self._joints, strict=True):
            # Grip is the tire's business; the engine's contact only carries.
            engine.changeDynamics(body, link, lateralFriction=0, restitution=wheel.restitution)
            engine.setCollisionFilterGroupMask(body, link, WHEEL, COLLIDES_WITH[WHEEL])
        # Joints come with motors that hold them; those of the springs must let go.
        engine.setJointMotorControlArray(
            body, self._joints, engine.VELOCITY_CONTROL, forces=[0] * self._count
        )

    def sense(self) -> None:
        """Read from the engine where the base and the springs are, and how they move."""
        engine, body = self._engine, self.body
        self._sprung = engine.getJointStates(body, self._joints)
        center, self._quaternion = engine.getBasePositionAndOrientation(body)
        velocity, self._turn = engine.getBaseVelocity(body)
        # From Bullet's center of mass to the base link's origin.
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
        engine, body, zero = self._engine, self.body, (0.0, 0.0, 0.0)
        engine.resetBaseVelocity(body, zero, zero)
        for joint, (position, *_) in zip(self._joints, self._sprung, strict=True):
            engine.resetJointState(body, joint, position, 0.0)
        self.sense()

    def at_rest(self) -> RestState:
        """Return how it rests, its velocities taken as zero."""
        return RestState(
            self._engine.getBasePositionAndOrientation(self.body)[0],
            self._quaternion,
            tuple(position for position, *_ in self._sprung),
            tuple(wheel.tire.deflection_m for wheel in self.running_gear.wheels),
            self._touches(0),
        )

    def put(self, rest: RestState) -> None:
        """Put it where another one of its model rests, before the first step."""
        engine, body = self._engine, self.body
        engine.resetBasePositionAndOrientation(body, rest.center_m, rest.orientation)
        for joint, position in zip(self._joints, rest.springs_m, strict=True):
            engine.resetJointState(body, joint, position, 0.0)
        for wheel, deflection in zip(self.running_gear.wheels, rest.treads_m, strict=True):
            wheel.tire.deflection_m = deflection
        self._first_touches = rest.touches
        self.sense()

    @property
    def position_m(self) -> Vector3:
        """The base's origin in the world."""
        return self._origin

    def act(self, sim_nanos: int) -> None:
        """Set the forces of springs, tires and motors for the step from `sim_nanos`."""
        engine, running_gear = self._engine, self.running_gear
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        (vx, vy, vz), (wx, wy, wz) = self._velocity, self._turn
        vx, vy, vz = a * vx + d * vy + g * vz, b * vx + e * vy + h * vz, c * vx + f * vy + i * vz
        turn = a * wx + d * wy + g * wz, b * wx + e * wy + h * wz, c * wx + f * wy + i * wz
        (x, y, z), torque, along_springs = running_gear.go(
            self.drive.wheels(sim_nanos, running_gear.angles()),
            velocity=(vx, vy, vz),
            turn=turn,
            springs=self._sprung,
            touches=self._touches(sim_nanos // TICK_NANOS),
        )
        self.servos.step(sim_nanos)
        self.energy_and_contacts.worked(running_gear.driving_w, running_gear.braking_w)
        if self._body_drag:
            (x, y, z), torque = self._body_drag.slow((x, y, z), torque, (vx, vy, vz), turn)
        engine.applyExternalForce(self.body, -1, (x, y, z), (0.0, 0.0, 0.0), engine.LINK_FRAME)
        engine.applyExternalTorque(self.body, -1, torque, engine.LINK_FRAME)
        # Along the base's z on the wheel; a spring pushes it down by what rests on it.
        engine.setJointMotorControlArray(
            self.body,
            self._joints,
            engine.TORQUE_CONTROL,
            forces=[
                force - preload - stiffness * spring[0] - damping * spring[1]
                for force, (preload, stiffness, damping), spring in zip(
                    along_springs, self._springs, self._sprung, strict=True
                )
            ],
        )

    def _touches(self, tick: int) -> list[Touch | None]:
        """Return what each wheel touched in the last step; what else did goes to the ledger."""
        if (first := self._first_touches) is not None:
            self._first_touches = None
            return first
        touches: list[Touch | None] = [None] * self._count
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        for contact in self._engine.getContactPoints(self.body):
            # The body's link, the other body, the point on it, the normal, its force.
            _, _, other, link, _, _, point, (x, y, z), _, force, *_ = contact
            if force <= 0.0:
                continue
            if (place := self._place.get(link)) is None:
                self.energy_and_contacts.touched((tick, other, point, force))
                continue
            grip = self._friction(other, point) * force
            x, y, z = x * force, y * force, z * force
            x, y, z = a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z
            if (before := touches[place]) is not None:
                grip, x, y, z = grip + before[0], x + before[1], y + before[2], z + before[3]
            touches[place] = grip, x, y, z
        return touches

    def motor_torques(self) -> memoryview:
        """Return what each wheel's motor put on its axle in the last step: float64, N m."""
        return memoryview(
            self._pack_wheels(*[wheel.torque_nm for wheel in self.running_gear.wheels])
        )

    def state(self) -> VehicleState:
        """Return where everything is after the last step."""
        # Not the engine's getLinkStates: after a step it still tells where the links were before.
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
                # Steered: turned about z first.
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
    """Return the rows of a unit quaternion's matrix; for one, numpy takes ten times as long."""
    x, y, z, w = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


def _load(engine: Engine, vehicle: Vehicle, ground: Ground | None) -> int:
    """Put a vehicle into the engine with its wheels on the ground, and return its body."""
    model = vehicle.model
    origin, turn = start(vehicle, ground)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"{vehicle.name}.urdf")
        file.write_text(urdf(model))
        for mesh in {p.shape for p in model.collisions if isinstance(p.shape, Mesh)}:
            Path(folder, hull_file(mesh)).write_text(hull(surface(mesh.asset).vertices))
        body: int = engine.loadURDF(
            str(file),
            origin,
            turn,
            flags=engine.URDF_USE_INERTIA_FROM_FILE | engine.URDF_USE_IMPLICIT_CYLINDER,
        )
    return body


def _preloads(model: VehicleModel) -> list[float]:
    """Return the force (N) with which each spring carries the chassis at rest.

    Forces and their moments balance the weight of the chassis and of the wheels that hang in the
    air; of all such loads, the one with the smallest sum of squares, which springs of one stiffness
    take. Springs of wheels in the air hold these up: less than nothing.
    """
    standing = np.array([model.stands_on(wheel) for wheel in model.wheels])
    places = np.array([(1.0, *wheel.center_m[:2]) for wheel in model.wheels]).T
    hanging = np.where(standing, 0.0, [wheel.mass_kg for wheel in model.wheels])
    x, y, _ = model.chassis.center_m
    weights = GRAVITY_MPS2 * (model.chassis.mass_kg * np.array([1.0, x, y]) + places @ hanging)
    loads = np.linalg.lstsq(places * standing, weights)[0] - GRAVITY_MPS2 * hanging
    preloads: list[float] = loads.tolist()
    return preloads
