# SPDX-License-Identifier: Apache-2.0
"""One vehicle in the backend: its body, springs, running gear and joints.

States are in the frames of the model (the base link's origin, not the center of mass) and in the
model's order of links and wheels.
"""

from collections.abc import Iterable, Mapping, Sequence
from ctypes import POINTER, Structure, byref, c_double, c_int32, c_size_t, c_void_p, pointer
from typing import NamedTuple

import numpy as np

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import matrix_from_quaternion
from groundlink.messages.base import VehicleState, floats, packed
from groundlink.messages.ground_truth import WheelInSoil
from groundlink.messages.navigation import JointState
from groundlink.scenario.schema import Vehicle
from groundlink.scenario.vehicle import Bumper, Payload, VehicleModel
from groundlink.scene.spawn_pose import spawn_pose
from groundlink.world.cover import WaterArea
from groundlink.world.mesh_asset import load_mesh
from groundlink.world.roughness import RoughGround
from groundlink.world.solids import Mesh, Soil, Solid
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
from services.physics.dynamics.bodies import ArticulatedBody, BodyList, ContactPoint, pointers
from services.physics.dynamics.chassis_contacts import ChassisContacts
from services.physics.dynamics.kernels import kernels
from services.physics.dynamics.memory import PartWithMemory, numbers_of, set_numbers
from services.physics.running_gear.linkage import balance_rows
from services.physics.running_gear.running_gear import GroundContact, RunningGear
from services.physics.running_gear.soil_wheel import soil_wheels

from .body_drag import body_drag
from .controller import Controller, WheelTargets
from .joint_commands import JointCommandReader
from .memory import VehicleMemory
from .ride import EngineShake, Ride
from .servos import Servos
from .urdf import convex_hull, hull_file, suspension_joint, urdf
from .water import VehicleInWater

BOX_POINTS = 4
"""Points at which a side of a box touches a wall; how many touch is known after the first tick."""


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


_VECTOR = c_double * 3


class LinkOfJoint(Structure):
    """Pose of a link that a servo moves, in the base frame."""

    _fields_ = (("position_m", _VECTOR), ("orientation", c_double * 4))


class SimulatedVehicle(Structure):
    """A vehicle, at first standing on its springs at its placement.

    A `Fleet` steps it; `vehicle.c` computes its forces.

    Parameters
    ----------
    ground
        the terrain at its placement; None: flat ground.
    soils
        of the world's ground; empty: all of it is firm.
    rough
        heights of rough ground; None: all is smooth.
    water
        all water of the world.
    epoch_nanos
        stamp of sim time zero.
    """

    _fields_ = (
        ("_body", POINTER(ArticulatedBody)),
        ("_gear", POINTER(RunningGear)),
        ("_com", _VECTOR),
        ("_drag_nspm2", c_double),
        ("_linear_nspm", c_double),
        ("_angular_nmsprad", _VECTOR),
        ("shake_n", c_double),
        ("_keeps_contacts", c_int32),
        ("_rows", _VECTOR * 3),
        ("_origin", _VECTOR),
        ("_velocity", _VECTOR),
        ("_links", POINTER(LinkOfJoint)),
        ("_link_count", c_size_t),
        ("_wading", POINTER(VehicleInWater)),
        ("_link_poses", c_void_p),
        ("_base_velocity", c_void_p),
        ("_joint_positions", c_void_p),
        ("_joint_velocities", c_void_p),
        ("_servo_positions", c_void_p),
        ("_servo_velocities", c_void_p),
    )
    shake_n: float
    """Force of the engine's vibration in this tick, along the base's z."""

    def __init__(
        self,
        backend: Backend,
        vehicle: Vehicle,
        *,
        ground: Ground | None = None,
        soils: Sequence[Soil] = (),
        rough: RoughGround | None = None,
        water: Sequence[WaterArea] = (),
        epoch_nanos: int = 0,
    ) -> None:
        self._backend = backend
        self._model = model = vehicle.model.with_effects(vehicle.effects)
        payload = vehicle.payload or ()
        self.drive = Controller(model, epoch_nanos=epoch_nanos)
        self.servos = Servos(model.joints, epoch_nanos=epoch_nanos)
        self._joint_commands = JointCommandReader(model)
        self.contacts = ChassisContacts()
        collisions = (part.shape for part in model.collisions)
        hulls = {
            hull_file(mesh): convex_hull(load_mesh(mesh.asset).vertices)
            for mesh in collisions
            if isinstance(mesh, Mesh)
        }
        self.articulated = body = backend.add_articulated(
            urdf(model, payload, sinks=bool(soils)),
            hulls,
            [*map(suspension_joint, model.wheels), *(arm.name for arm in model.arms)],
            spawn_pose(vehicle, ground),
        )
        self.body, self._alone = body.number, BodyList([body])
        self._count = count = len(model.wheels)
        # Springs carry the model alone at rest, and a payload presses them further.
        coupling_m = vehicle.towed_by.coupling_m if vehicle.towed_by else None
        preloads = spring_loads(model, coupling_m=coupling_m)
        loads = spring_loads(model, payload, coupling_m=coupling_m)
        model_kg = model.chassis.mass_kg + sum(wheel.mass_kg for wheel in model.wheels)
        model_kg += sum(arm.mass_kg for arm in model.arms)
        whole_kg = model_kg + sum(load.mass_kg for load in payload)
        # A wheel held in the air counts with an equal share of the whole mass.
        borne_kg = [
            load / GRAVITY_MPS2 + wheel.mass_kg if load > 0.0 else whole_kg / count
            for load, wheel in zip(loads, model.wheels, strict=True)
        ]
        links = vibration.tread if (vibration := vehicle.model.vibration) else None
        pitch_m = links.pitch_m if links else None
        air_pa = vehicle.tire_pressure_pa or None
        sinking = soil_wheels(model, borne_kg, soils, pitch_m, air_pa) if soils else ()
        self.running_gear = RunningGear(model, preloads, borne_kg, sinking)
        tread, engine = (v.tread, v.engine) if (v := model.vibration) else (None, None)
        self.ride = Ride(self.running_gear.wheels, rough, tread) if rough or tread else None
        self._engine_shake = (
            EngineShake(engine, mass_kg=model_kg, top_speed_mps=model.top_speed_mps)
            if engine
            else None
        )
        self._kept_links = (LinkOfJoint * len(model.joints))()
        drag = body_drag(model, payload)
        self.water = VehicleInWater(vehicle.model, water) if water else None
        super().__init__(
            *(pointer(body), pointer(self.running_gear), _VECTOR(*model.chassis.center_m)),
            *(drag.drag_nspm2, drag.linear_nspm, _VECTOR(*drag.angular_nmsprad)),
            _links=self._kept_links,
            _link_count=len(model.joints),
            _wading=self.water and pointer(self.water),
        )
        self._asked: WheelTargets | None = None
        self._state = self.blank_state()
        self._set_surfaces()
        self._bumper_points = 0
        if model.bumper:
            self._share_bumper(model.bumper, BOX_POINTS)
        self._place_links()
        self.sense()

    def _set_surfaces(self) -> None:
        chassis = self._model.chassis
        surface = Surface(chassis.friction, chassis.restitution, CHASSIS)
        self._backend.set_surface(self.body, surface)
        for wheel, joint in zip(self._model.wheels, self.articulated.joints, strict=False):
            # The tire model makes the grip; the backend's contact only carries.
            surface = Surface(0.0, wheel.restitution, WHEEL)
            self._backend.set_surface(self.body, surface, joint.link)

    def _share_bumper(self, bumper: Bumper, points: int) -> None:
        """Give each of a number of contact points its share of the bumper."""
        if points != self._bumper_points:
            self._bumper_points = points
            self._backend.set_contact_spring(
                self.body, bumper.stiffness_npm / points, bumper.damping_nspm / points
            )

    def sense(self) -> None:
        """Read the motion of the base and the springs from the backend."""
        self._backend.sense(self._alone)
        kernels().vehicles_sense(pointers([self]), 1)

    @property
    def fastest(self) -> float:
        """The largest component of its velocities: m/s, rad/s, and m/s of springs."""
        springs = (joint.velocity_mps for joint in self.articulated.joints)
        return float(max(map(abs, (*self._velocity, *self.articulated.turn_radps, *springs))))

    def stop(self) -> None:
        """Take all velocities away."""
        zero = (0.0, 0.0, 0.0)
        self._backend.set_velocity(self.body, zero, zero)
        self._set_springs([(joint.position_m, 0.0) for joint in self.articulated.joints])
        self.sense()

    def _set_springs(self, states: Sequence[tuple[float, float]]) -> None:
        self._backend.set_joint_states(self.articulated, states)

    def at_rest(self) -> RestState:
        """Return its present state with all velocities zero, after `Fleet.touch`."""
        center, orientation = self._backend.pose(self.body)
        wheels = self.running_gear.wheels
        return RestState(
            center,
            orientation,
            tuple(joint.position_m for joint in self.articulated.joints),
            tuple(wheel.tire.deflection_m for wheel in wheels),
            [wheel.contact for wheel in wheels],
        )

    def put(self, rest: RestState) -> None:
        """Set its state to the rest of another vehicle of its model, before the first step."""
        self._backend.set_pose(self.body, (rest.center_m, rest.orientation))
        self._set_springs([(position, 0.0) for position in rest.springs_m])
        for wheel, deflection in zip(self.running_gear.wheels, rest.treads_m, strict=True):
            wheel.tire.deflection_m = deflection
        self._begin_with(rest.contacts)
        self.sense()

    def _begin_with(self, contacts: Iterable[GroundContact | None]) -> None:
        """Set the wheels' contacts of the next tick, instead of those of the last step."""
        for wheel, contact in zip(self.running_gear.wheels, contacts, strict=True):
            wheel.contact = contact
        self._keeps_contacts = True

    def memory(self, bodies: Mapping[int, Sequence[Solid]]) -> VehicleMemory:
        """Return all that the next tick depends on, after `Fleet.touch`.

        Parameters
        ----------
        bodies
            solids of each body.
        """
        backend, wheels = self._backend, self.running_gear.wheels
        return VehicleMemory(
            pose=backend.pose(self.body),
            twist=backend.velocity(self.body),
            springs=tuple((j.position_m, j.velocity_mps) for j in self.articulated.joints),
            ground_contacts=tuple(wheel.contact for wheel in wheels),
            roughness_under=tuple(wheel.under for wheel in wheels) if self.ride else (),
            bumper_points=self._bumper_points,
            contacts=self.contacts.named(bodies),
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
        self._set_springs(memory.springs)
        self._backend.set_velocity(self.body, *memory.twist)
        self._begin_with(memory.ground_contacts)
        if self.ride:
            for wheel, under in zip(self.running_gear.wheels, memory.roughness_under, strict=True):
                wheel.under = under
        if self._model.bumper:
            self._share_bumper(self._model.bumper, memory.bumper_points)
        self.contacts.remember(memory.contacts)
        self.drive.remember(memory.drive)
        self.servos.remember(memory.servos)
        set_numbers(self._parts(), memory.numbers)
        self._place_links()
        self.sense()

    def _parts(self) -> list[PartWithMemory]:
        """Return the parts whose inner state is numbers."""
        lifts = self.ride.lifts if self.ride else []
        shake = [self._engine_shake] if self._engine_shake else []
        steering, gear = self.drive.steering, self.running_gear.parts()
        water = [self.water] if self.water else []
        return [self.running_gear.work, steering, *gear, *lifts, *shake, *water]

    def place(self, pose: Pose | None, twist: Twist | None) -> None:
        """Set pose or velocity of the base's origin; None: unchanged.

        With a new pose its springs are as at the start, and its wheels touch the ground from the
        next step on; with a new velocity they roll along.
        """
        (x, y, z), orientation = pose or self.pose()
        (vx, vy, vz), (wx, wy, wz) = twist or self.twist()
        cx, cy, cz = self._com
        (a, b, c), (d, e, f), (g, h, i) = matrix_from_quaternion(orientation).tolist()
        # From the base link's origin to the center of mass.
        dx, dy, dz = a * cx + b * cy + c * cz, d * cx + e * cy + f * cz, g * cx + h * cy + i * cz
        if pose is not None:
            self._backend.set_pose(self.body, ((x + dx, y + dy, z + dz), orientation))
            self._set_springs([(0.0, 0.0)] * self.articulated.joint_count)
            self._begin_with([None] * self._count)
        # A new pose has taken the velocity away.
        velocity = vx + wy * dz - wz * dy, vy + wz * dx - wx * dz, vz + wx * dy - wy * dx
        self._backend.set_velocity(self.body, velocity, (wx, wy, wz))
        if twist is not None:
            forward_mps, left_mps = a * vx + d * vy + g * vz, b * vx + e * vy + h * vz
            self.running_gear.roll(forward_mps, left_mps, c * wx + f * wy + i * wz)
        self.sense()

    def from_center(self, place_m: Vector3) -> Vector3:
        """Return a place in the base frame from the base's center of mass."""
        (x, y, z), (cx, cy, cz) = place_m, self._com
        return x - cx, y - cy, z - cz

    def pose(self) -> Pose:
        """Return world_from_base."""
        qx, qy, qz, qw = self.articulated.orientation
        return self.position_m, (qx, qy, qz, qw)

    def twist(self) -> Twist:
        """Return the velocity of the base's origin in the world."""
        (vx, vy, vz), (wx, wy, wz) = self._velocity, self.articulated.turn_radps
        return (vx, vy, vz), (wx, wy, wz)

    @property
    def position_m(self) -> Vector3:
        """The base's origin in the world."""
        x, y, z = self._origin
        return x, y, z

    def follow_commands(self, sim_nanos: int) -> None:
        """Set targets of shafts, steering joints and servos for the step from `sim_nanos`."""
        gear = self.running_gear
        if (targets := self.drive.wheels(sim_nanos, gear.angles())) is not self._asked:
            self._asked = targets
            gear.ask(*targets)
        if self.servos.step(sim_nanos):
            self._place_links()
        if self._engine_shake:
            (a, _, _), (d, _, _), (g, _, _) = self._rows
            vx, vy, vz = self._velocity
            self.shake_n = self._engine_shake.force_n(a * vx + d * vy + g * vz)

    def _place_links(self) -> None:
        """Place links where their servos are, and write where these are."""
        for link, (position, orientation) in zip(self._kept_links, self.servos.poses, strict=True):
            link.position_m[:], link.orientation[:] = position, orientation
        for kept, now in zip(
            (self._state.servo_positions, self._state.servo_velocities),
            self.servos.state,
            strict=True,
        ):
            kept[: len(now)] = now

    def follow_roughness(self) -> None:
        """Lift the wheels by the ground that they touch and by their treads in this tick."""
        assert self.ride is not None
        (a, b, c), (d, e, f), _ = self._rows
        ox, oy, _ = self._origin
        centers = [wheel.center_m for wheel in self.running_gear.wheels]
        self.ride.follow(
            [(ox + a * x + b * y + c * z, oy + d * x + e * y + f * z) for x, y, z in centers]
        )

    def touched(self, tick: int, contacts: Sequence[ContactPoint]) -> None:
        """Record contacts of the chassis in the last step."""
        for contact in contacts:
            self.contacts.touched((tick, contact.other, contact.point_m, contact.force_n))
        if self._model.bumper:
            self._share_bumper(self._model.bumper, len(contacts))

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
        torques = (c_double * self._count)()
        kernels().vehicle_torques(byref(self), torques)
        return memoryview(torques).cast("B")

    def wheels_in_soil(self) -> tuple[WheelInSoil, ...]:
        """Return slip and sinkage of the wheels that stand on soil."""
        return tuple(
            WheelInSoil(described.name, soil.slip, soil.sinkage_m)
            for described, wheel in zip(self._model.wheels, self.running_gear.wheels, strict=True)
            if (soil := wheel.soil) and soil.is_in_soil
        )

    def blank_state(self) -> VehicleState:
        """Return a state of the size of its states, with zeros."""
        moved = len(self._model.moving_names)
        wheels, joints = bytes(8 * self._count), bytes(8 * moved)
        links = bytes(7 * 8 * (1 + self._count + moved))
        parts = (links, bytes(6 * 8), wheels, wheels, joints, joints)
        return VehicleState(*(memoryview(bytearray(part)) for part in parts))

    def write_to(self, state: VehicleState) -> None:
        """Have a fleet write its states into the memory of this one."""
        self._state = state
        self._place_links()
        self._link_poses, self._base_velocity, self._joint_positions, self._joint_velocities = (
            floats(part).ctypes.data
            for part in (
                *(state.link_poses, state.base_velocity),
                *(state.joint_positions, state.joint_velocities),
            )
        )
        self._servo_positions, self._servo_velocities = (
            floats(part).ctypes.data for part in (state.servo_positions, state.servo_velocities)
        )


def spring_loads(
    model: VehicleModel, payload: Sequence[Payload] = (), *, coupling_m: Vector3 | None = None
) -> list[float]:
    """Return the force (N) with which each spring carries chassis, arms and payload at rest.

    Forces and their moments balance the weight of all and of wheels in the air. Of all such loads,
    the one with the smallest sum of squares: that of springs of one stiffness. The springs of
    wheels in the air hold these up, so their force is negative.

    Parameters
    ----------
    coupling_m
        of a towed vehicle: its hitch carries like a spring.
    """
    standing = np.array([model.stands_on(wheel) for wheel in model.wheels])
    places = np.array([(1.0, *wheel.center_m[:2]) for wheel in model.wheels]).T
    hanging = np.where(standing, 0.0, [wheel.mass_kg for wheel in model.wheels])
    x, y, _ = model.chassis.center_m
    weights = model.chassis.mass_kg * np.array([1.0, x, y]) + places @ hanging
    others = [(load.mass_kg, load.at_m) for load in payload]
    others += [(arm.mass_kg, arm.mass_center_m) for arm in model.arms]
    for mass_kg, at_m in others:
        weights = weights + mass_kg * np.array([1.0, *at_m[:2]])
    if model.linkage:
        rows, sums = zip(*balance_rows(model), strict=True)
        places, weights = np.vstack([places, rows]), np.append(weights, sums)
    carrying = places * standing
    if coupling_m is not None:
        at_hitch = [1.0, *coupling_m[:2], *[0.0] * (len(carrying) - 3)]
        carrying = np.column_stack([carrying, at_hitch])
    balance = np.linalg.lstsq(carrying, GRAVITY_MPS2 * weights)[0][: len(hanging)]
    loads: list[float] = (balance - GRAVITY_MPS2 * hanging).tolist()
    return loads
