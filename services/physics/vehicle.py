# SPDX-License-Identifier: Apache-2.0
"""One vehicle in the physics engine: its body, its springs, its motors, and where it all is.

Rule: what leaves this module is in the frames of the model (the base link's origin, not Bullet's
centre of mass) and in the model's order of links and wheels.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from math import cos, radians, sin
from pathlib import Path
from struct import Struct

import numpy as np

from groundlink.clock import TICK_NANOS
from groundlink.messages import VehicleState
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Material, Quaternion, Vector3

from .drive import SkidSteering, Speeds
from .engine import GRAVITY_MPS2, Engine
from .ledger import Ledger
from .statics import CHASSIS, MEETS, WHEEL
from .tyre import Tyre
from .urdf import knuckle_joint, rim_mass, urdf


class SimulatedVehicle:
    """A vehicle that stands on its springs at its placement.

    Parameters
    ----------
    engine
        the world that it is put into.
    vehicle
        model and placement.
    materials
        of the world.
    frictions
        of the static bodies, by the engine's number.
    epoch_nanos
        stamp of sim time zero.
    """

    def __init__(
        self,
        engine: Engine,
        vehicle: Vehicle,
        materials: Mapping[str, Material],
        frictions: Mapping[int, float],
        *,
        epoch_nanos: int = 0,
    ) -> None:
        self._engine = engine
        self._model = model = vehicle.model
        self._frictions = frictions
        self.drive = SkidSteering(model, epoch_nanos=epoch_nanos)
        self.ledger = Ledger()
        self.body = body = _load(engine, vehicle, materials)
        indices = {
            engine.getJointInfo(body, joint)[1].decode(): joint
            for joint in range(engine.getNumJoints(body))
        }
        self._wheels = [indices[wheel.name] for wheel in model.wheels]
        self._knuckles = [indices[knuckle_joint(wheel)] for wheel in model.wheels]
        self._joints = self._knuckles + self._wheels
        self._count = count = len(model.wheels)
        self._suspension = (model.suspension.stiffness_npm, model.suspension.damping_nspm)
        self._preloads = _preloads(model)
        self._tyres = [
            (
                Tyre(rim_mass_kg=rim_mass(wheel), axle_ratio=wheel.axle_friction_ratio),
                link,
                wheel.friction,
                wheel.radius_m,
                wheel.center_m,
            )
            for wheel, link in zip(model.wheels, self._wheels, strict=True)
        ]
        self._com = model.chassis.center_m
        self._centers = [wheel.center_m for wheel in model.wheels]
        self._torques = [model.drive.max_wheel_torque_nm] * count
        self._asked: Speeds = ()
        self._axles: tuple[tuple[float, ...], ...] = ()
        self._pack_links = Struct(f"<{7 * (count + 1)}d").pack
        self._pack_wheels = Struct(f"<{count}d").pack
        self._pack_velocity = Struct("<6d").pack
        self._set_dynamics()
        self.sense()

    def _set_dynamics(self) -> None:
        engine, body, chassis = self._engine, self.body, self._model.chassis
        for link in range(-1, engine.getNumJoints(body)):
            # Bullet would damp every motion by 4 % a second.
            engine.changeDynamics(body, link, linearDamping=0, angularDamping=0, jointDamping=0)
        engine.changeDynamics(
            body, -1, lateralFriction=chassis.friction, restitution=chassis.restitution
        )
        engine.setCollisionFilterGroupMask(body, -1, CHASSIS, MEETS[CHASSIS])
        for link in self._wheels:
            # Grip is the tyre's business; the engine's contact only carries.
            engine.changeDynamics(body, link, lateralFriction=0, restitution=0)
            engine.setCollisionFilterGroupMask(body, link, WHEEL, MEETS[WHEEL])
        # Joints come with motors that hold them; those of the springs must let go.
        engine.setJointMotorControlArray(
            body, self._knuckles, engine.VELOCITY_CONTROL, forces=[0] * self._count
        )

    def sense(self) -> None:
        """Read from the engine where the base and the joints are, and how they move."""
        engine, body = self._engine, self.body
        states = engine.getJointStates(body, self._joints)
        self._springs, axles = states[: self._count], states[self._count :]
        self.ledger.worked(self._axles, axles)
        self._axles = axles
        center, self._quaternion = engine.getBasePositionAndOrientation(body)
        velocity, self._turn = engine.getBaseVelocity(body)
        # From Bullet's centre of mass to the base link's origin.
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

    def act(self, sim_nanos: int) -> None:
        """Set the forces of springs, tyres and motors for the step from `sim_nanos`."""
        engine = self._engine
        stiffness, damping = self._suspension
        # Along the base's z on the wheel; a spring pushes it down by what rests on it.
        forces = [
            -preload - stiffness * spring[0] - damping * spring[1]
            for preload, spring in zip(self._preloads, self._springs, strict=True)
        ]
        engine.setJointMotorControlArray(
            self.body,
            self._joints,
            engine.TORQUE_CONTROL,
            forces=forces + self._grip(sim_nanos // TICK_NANOS),
        )
        speeds = self.drive.speeds(sim_nanos)
        if speeds != self._asked:
            self._asked = speeds
            engine.setJointMotorControlArray(
                self.body,
                self._wheels,
                engine.VELOCITY_CONTROL,
                targetVelocities=speeds,
                forces=self._torques,
            )

    def _grip(self, tick: int) -> list[float]:
        """Push the base as the tyres do, and return the torque that they put on each axle, N m.

        The ground under a wheel is taken as parallel to the base's x and y. Forces act where the
        tyres touch; of their moment, the part about an axle turns the wheel on it.
        """
        engine = self._engine
        limits = dict.fromkeys(self._wheels, 0.0)
        for contact in engine.getContactPoints(self.body):
            # The body's link, the other body, the normal force.
            if (link := contact[3]) in limits:
                limits[link] += self._frictions[contact[2]] * contact[9]
            elif contact[9] > 0.0:
                self.ledger.touched((tick, contact[2], contact[6], contact[9]))
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        (vx, vy, vz), (wx, wy, wz) = self._velocity, self._turn
        ux, uy = a * vx + d * vy + g * vz, b * vx + e * vy + h * vz
        ox, oy, oz = a * wx + d * wy + g * wz, b * wx + e * wy + h * wz, c * wx + f * wy + i * wz
        com_x, com_y, com_z = self._com
        fx = fy = tx = ty = tz = 0.0
        torques = []
        for (tyre, link, friction, radius, (x, y, z)), axle in zip(
            self._tyres, self._axles, strict=True
        ):
            z -= radius
            forward, left = tyre.force(
                ux + oy * z - oz * y - axle[1] * radius,
                uy + oz * x - ox * z,
                friction * limits[link],
            )
            fx += forward
            fy += left
            tx -= (z - com_z) * left
            ty += (z - com_z) * forward
            tz += (x - com_x) * left - (y - com_y) * forward
            torques.append(-radius * forward)
        engine.applyExternalForce(self.body, -1, (fx, fy, 0.0), (0.0, 0.0, 0.0), engine.LINK_FRAME)
        engine.applyExternalTorque(self.body, -1, (tx, ty, tz), engine.LINK_FRAME)
        return torques

    def motor_torques(self) -> memoryview:
        """Return what each wheel's motor put on its axle in the last step: float64, N m."""
        return memoryview(self._pack_wheels(*[axle[3] for axle in self._axles]))

    def state(self) -> VehicleState:
        """Return where everything is after the last step."""
        # Not the engine's getLinkStates: after a step it still tells where the links were before.
        x, y, z = self._origin
        qx, qy, qz, qw = self._quaternion
        poses = [x, y, z, qx, qy, qz, qw]
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        for (cx, cy, cz), spring, axle in zip(
            self._centers, self._springs, self._axles, strict=True
        ):
            cz += spring[0]
            sine, cosine = sin(axle[0] / 2), cos(axle[0] / 2)
            poses += (
                x + a * cx + b * cy + c * cz,
                y + d * cx + e * cy + f * cz,
                z + g * cx + h * cy + i * cz,
                # base_from_wheel is a turn about y: (0, sine, 0, cosine).
                qx * cosine - qz * sine,
                qy * cosine + qw * sine,
                qz * cosine + qx * sine,
                qw * cosine - qy * sine,
            )
        return VehicleState(
            memoryview(self._pack_links(*poses)),
            memoryview(self._pack_velocity(*self._velocity, *self._turn)),
            memoryview(self._pack_wheels(*[axle[0] for axle in self._axles])),
            memoryview(self._pack_wheels(*[axle[1] for axle in self._axles])),
        )


def _matrix(quaternion: Quaternion) -> tuple[Vector3, Vector3, Vector3]:
    """Return the rows of a unit quaternion's matrix; for one, numpy takes ten times as long."""
    x, y, z, w = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


def _load(engine: Engine, vehicle: Vehicle, materials: Mapping[str, Material]) -> int:
    """Put a vehicle into the engine with its wheels on the ground, and return its body."""
    model, place = vehicle.model, vehicle.placement
    half = radians(place.yaw_deg) / 2
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"{vehicle.name}.urdf")
        file.write_text(urdf(model, materials))
        body: int = engine.loadURDF(
            str(file),
            [place.x_m, place.y_m, place.z_m + model.base_height_m],
            [0.0, 0.0, sin(half), cos(half)],
            flags=engine.URDF_USE_INERTIA_FROM_FILE | engine.URDF_USE_IMPLICIT_CYLINDER,
        )
    return body


def _preloads(model: VehicleModel) -> list[float]:
    """Return the force (N) with which each spring carries the chassis at rest.

    Forces and their moments balance the chassis' weight; of all such loads, the one with the
    smallest sum of squares, which springs of one stiffness take.
    """
    centers = np.array([wheel.center_m[:2] for wheel in model.wheels])
    balance = np.vstack([np.ones(len(centers)), centers.T])
    weight = model.chassis.mass_kg * GRAVITY_MPS2
    x, y, _ = model.chassis.center_m
    loads: list[float] = np.linalg.lstsq(balance, weight * np.array([1.0, x, y]))[0].tolist()
    return loads
