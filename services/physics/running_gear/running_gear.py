# SPDX-License-Identifier: Apache-2.0
"""Running gear of a vehicle: wheels that roll on the ground, turn on shafts and are steered.

Motion of the base, springs and contacts come in, forces go out; all vectors are in the base frame.
`running_gear.c` computes them. To the backend, wheels are spheres without friction that slide on
springs: turning, grip and steering are here.
"""

from collections.abc import Sequence
from ctypes import POINTER, Structure, byref, c_double, c_int32, c_size_t, pointer
from math import cos, nan, radians, sin

from groundlink.core.clock import TICK_SECONDS
from groundlink.messages.ground_truth import BatteryState
from groundlink.scenario.running_gear import Ackermann, Suspension, Wheel
from groundlink.scenario.vehicle import VehicleModel
from services.physics.dynamics.bodies import pointers
from services.physics.dynamics.kernels import kernels
from services.physics.dynamics.memory import PartWithMemory

from .linkage import ArmLinkage, SwingingArm
from .motor import BatteryCharge, Motors
from .shaft import TurningShaft
from .soil_wheel import SoilWheel
from .tire import Tire

_VECTOR = c_double * 3


class SteeringJoint(Structure):
    """The joint of one steered wheel, straight ahead at first.

    It turns within the speed, torque and range of its drive. The tire's footprint resists, a strip
    as long as the wheel is wide. At standstill all of its points rub; the faster the wheel rolls,
    the less it resists.
    """

    MEMORY = ("angle_rad", "speed_radps")

    _fields_ = (
        ("_range", c_double),
        ("_most_radps", c_double),
        ("_most_nm", c_double),
        ("_inertia", c_double),
        ("_lever_m", c_double),
        ("asked_rad", c_double),
        ("angle_rad", c_double),
        ("speed_radps", c_double),
    )
    asked_rad: float
    angle_rad: float
    speed_radps: float

    def __init__(self, wheel: Wheel, drive: Ackermann) -> None:
        super().__init__(
            radians(drive.max_steering_deg),
            radians(drive.steering_speed_degps),
            drive.steering_torque_nm,
            wheel.mass_kg * (3 * wheel.radius_m**2 + wheel.width_m**2) / 12,
            # Mean distance of the strip's points from its middle.
            wheel.width_m / 4,
        )

    def turn(self, asked_rad: float, grip_n: float, rolling_mps: float) -> None:
        """Advance by a tick.

        Parameters
        ----------
        grip_n
            friction times load of the tire.
        rolling_mps
            speed of rolling.
        """
        self.asked_rad = asked_rad
        kernels().steering_joint_turn(byref(self), grip_n, rolling_mps)


def steering_joints(model: VehicleModel) -> dict[str, SteeringJoint]:
    """Return the steering joints of a vehicle by wheel, in the order of its drive."""
    drive = model.drive
    if not isinstance(drive, Ackermann):
        return {}
    wheels = {wheel.name: wheel for wheel in model.wheels}
    return {name: SteeringJoint(wheels[name], drive) for name in drive.steered}


GroundContact = tuple[float, float, float, float]
"""Sums over a wheel's contact points: normal force times the ground's coefficient of friction, N,
and the normal forces on the wheel, N, in the base frame."""

IN_AIR = -1.0
"""Roughness under a wheel that touches nothing."""


class RollingWheel(Structure):
    """One wheel of the running gear.

    Parameters
    ----------
    preload_n
        force of its spring at rest.
    """

    _fields_ = (
        ("center_m", _VECTOR),
        ("radius_m", c_double),
        ("_friction", c_double),
        ("_resistance", c_double),
        ("ratio", c_double),
        ("_yaw", c_double),
        ("_axle", c_double * 2),
        ("_rollers", c_double * 2),
        ("_preload_n", c_double),
        ("_stiffness_npm", c_double),
        ("_damping_nspm", c_double),
        ("_tire", POINTER(Tire)),
        ("_shaft", POINTER(TurningShaft)),
        ("_steering", POINTER(SteeringJoint)),
        ("_soil", POINTER(SoilWheel)),
        ("_arm", POINTER(SwingingArm)),
        ("_touches", c_int32),
        ("_grip_n", c_double),
        ("_normal_n", _VECTOR),
        ("under", c_double),
        ("raised_m", c_double),
        ("raised_mps", c_double),
        ("_scratch", c_double * 10),
    )
    radius_m: float
    ratio: float
    """Turns of the wheel for one turn of its shaft."""

    grip: tuple[float, float]
    """Direction of its grip in the base frame, without steering."""

    of_tread: float
    """Speed in that direction for one of the rim."""

    under: float
    """Roughness of what it touches, in units of class A, or `IN_AIR`."""

    raised_m: float
    """By what is finer than the ground's geometry, see `ride`; and how fast."""

    raised_mps: float

    def __init__(
        self,
        wheel: Wheel,
        suspension: Suspension,
        preload_n: float,
        tire: Tire,
        steering_joint: SteeringJoint | None,
        soil: SoilWheel | None,
        arm: SwingingArm | None,
    ) -> None:
        self.tire, self.soil = tire, soil
        yaw, rolls = wheel.yaw_rad, radians(wheel.rollers.angle_deg) if wheel.rollers else 0.0
        # Without a yaw the zero has the sign that it had before there were any.
        axle = (-sin(yaw), cos(yaw)) if yaw else (0.0, 1.0)
        self.grip = cos(yaw + rolls), sin(yaw + rolls)
        self.of_tread = cos(rolls)
        self.shaft: TurningShaft | None = None
        super().__init__(
            *(_VECTOR(*wheel.center_m), wheel.radius_m, wheel.friction, wheel.rolling_resistance),
            *(1.0, yaw, (c_double * 2)(*axle), (c_double * 2)(cos(rolls), sin(rolls))),
            *(preload_n, suspension.stiffness_npm, suspension.damping_nspm),
            *(pointer(tire), None, steering_joint and pointer(steering_joint)),
            soil and pointer(soil),
            arm and pointer(arm),
            under=IN_AIR,
        )

    def put_on(self, shaft: TurningShaft) -> None:
        """Have it turn with a shaft."""
        self.shaft, self._shaft = shaft, pointer(shaft)

    @property
    def contact(self) -> GroundContact | None:
        """Its contact with the ground in the last step; None in the air."""
        return (self._grip_n, *self._normal_n) if self._touches else None

    @contact.setter
    def contact(self, contact: GroundContact | None) -> None:
        self._touches = contact is not None
        self._grip_n, *normal = contact or (0.0, 0.0, 0.0, 0.0)
        self._normal_n = _VECTOR(*normal)

    @property
    def angle_rad(self) -> float:
        """Angle about its axle."""
        return self.shaft.angle_rad * self.ratio if self.shaft else 0.0

    @property
    def speed_radps(self) -> float:
        """Speed about its axle."""
        return self.shaft.speed_radps * self.ratio if self.shaft else 0.0

    @property
    def torque_nm(self) -> float:
        """Its share of the motor's torque."""
        return self.shaft.torque_nm / (self.ratio * len(self.shaft.tires)) if self.shaft else 0.0


class MotorWork(Structure):
    """Work of the motors of a vehicle since its start."""

    MEMORY = ("_braking_w", "_driving_w")

    _fields_ = (("_driving_w", c_double), ("_braking_w", c_double))
    _driving_w: float
    """Sum of the power over all ticks; so is `_braking_w`."""

    _braking_w: float

    @property
    def driven_j(self) -> float:
        """Work of driving motors, J."""
        return self._driving_w * TICK_SECONDS

    @property
    def braked_j(self) -> float:
        """Work taken up by braking motors, J."""
        return self._braking_w * TICK_SECONDS


class RunningGear(Structure):
    """The wheels of one vehicle, at rest.

    Parameters
    ----------
    preloads_n
        force of each wheel's spring at rest.
    borne_kg
        the mass that rests on each wheel on level ground.
    sinking
        the wheels in a world with soils; empty: all ground is firm.
    """

    MEMORY = ("_voltage_share", "driving_w", "braking_w")

    _fields_ = (
        ("_wheels", POINTER(POINTER(RollingWheel))),
        ("_shafts", POINTER(POINTER(TurningShaft))),
        ("_wheel_count", c_size_t),
        ("_driven_count", c_size_t),
        ("_shaft_count", c_size_t),
        ("_motors", Motors),
        ("_battery", POINTER(BatteryCharge)),
        ("_voltage_share", c_double),
        ("driving_w", c_double),
        ("braking_w", c_double),
        ("work", MotorWork),
        ("_linkage", ArmLinkage),
    )
    driving_w: float
    """Mechanical power of the motors in the last tick, driving; `braking_w`: braking."""

    braking_w: float
    work: MotorWork

    def __init__(
        self,
        model: VehicleModel,
        preloads_n: Sequence[float],
        borne_kg: Sequence[float],
        sinking: Sequence[SoilWheel | None] = (),
    ) -> None:
        self._charge = BatteryCharge(model.battery) if model.battery else None
        self.linkage = ArmLinkage(model)
        joints = steering_joints(model)
        self._steering_joints = tuple(joints.values())
        self.wheels = [
            RollingWheel(
                wheel,
                wheel.suspension or model.suspension,
                preload,
                Tire(
                    borne_kg=mass,
                    axle_ratio=wheel.rollers.friction_ratio
                    if wheel.rollers
                    else wheel.axle_friction_ratio,
                    slip=model.tire_slip,
                ),
                joints.get(wheel.name),
                soil,
                self.linkage.by_wheel.get(wheel.name),
            )
            for wheel, preload, mass, soil in zip(
                *(model.wheels, preloads_n, borne_kg),
                sinking or [None] * len(model.wheels),
                strict=True,
            )
        ]
        self._driven: list[TurningShaft] = []
        self._free: list[TurningShaft] = []
        for shaft in model.drive.shafts(model.wheels):
            parts = [(model.wheels[i], self.wheels[i]) for i in shaft.wheels]
            for wheel, rolling in parts:
                rolling.ratio = shaft.radius_m / wheel.radius_m
            turning = TurningShaft(
                [rolling.tire for _, rolling in parts],
                radius_m=shaft.radius_m * parts[0][1].of_tread,
                inertia_kgm2=shaft.inertia_kgm2
                + sum(w.axle_inertia_kgm2 * rolling.ratio**2 for w, rolling in parts),
                damping_nmsprad=sum(
                    w.axle_damping_nmsprad * rolling.ratio**2 for w, rolling in parts
                ),
            )
            for _, rolling in parts:
                rolling.put_on(turning)
            (self._driven if shaft.driven else self._free).append(turning)
        shafts = [*self._driven, *self._free]
        self._kept = pointers(self.wheels), pointers(shafts)
        super().__init__(
            *self._kept,
            *(len(self.wheels), len(self._driven), len(shafts)),
            *(Motors(model.drive), self._charge and pointer(self._charge), 1.0),
            _linkage=self.linkage,
        )

    def ask(
        self,
        speeds_radps: Sequence[float],
        angles_rad: Sequence[float],
        torques_nm: Sequence[float | None],
    ) -> None:
        """Set the targets of driven shafts and steering joints.

        Parameters
        ----------
        torques_nm
            the largest torque toward each target speed; None, as without values, for that of the
            motor.
        """
        torques_nm = torques_nm or (None,) * len(self._driven)
        for shaft, speed, torque in zip(self._driven, speeds_radps, torques_nm, strict=True):
            shaft.asked_radps = speed
            shaft.asked_nm = nan if torque is None else torque
        for joint, angle in zip(self._steering_joints, angles_rad, strict=True):
            joint.asked_rad = angle

    def parts(self) -> list[PartWithMemory]:
        """Return the gear and all of its parts that have inner state."""
        tires = (wheel.tire for wheel in self.wheels)
        sinking = (wheel.soil for wheel in self.wheels if wheel.soil)
        charge = [self._charge] if self._charge else []
        shafts = [*self._driven, *self._free]
        return [self, *shafts, *tires, *self._steering_joints, *charge, *sinking]

    def angles(self) -> tuple[float, ...]:
        """Return the angles of the steered wheels."""
        return tuple([joint.angle_rad for joint in self._steering_joints])

    def roll(self, forward_mps: float, left_mps: float, turn_radps: float) -> None:
        """Have all shafts turn as they do when the vehicle rolls at a velocity, without slip.

        Parameters
        ----------
        forward_mps, left_mps, turn_radps
            velocities of the base's origin, along x and y and about z of the base.
        """
        for shaft in (*self._driven, *self._free):
            speeds_mps = [
                wheel.grip[0] * (forward_mps - turn_radps * wheel.center_m[1])
                + wheel.grip[1] * (left_mps + turn_radps * wheel.center_m[0])
                for wheel in self.wheels
                if wheel.shaft is shaft
            ]
            shaft.roll(sum(speeds_mps) / len(speeds_mps))

    def steering_speeds(self) -> tuple[float, ...]:
        """Return the speeds at which the steered wheels are turned, rad/s."""
        return tuple([joint.speed_radps for joint in self._steering_joints])

    def battery(self) -> BatteryState | None:
        """Return the state of the battery, None without one."""
        if (charge := self._charge) is None:
            return None
        return BatteryState(charge.share, charge.voltage_v, charge.current_a)
