# SPDX-License-Identifier: Apache-2.0
"""Running gear of a vehicle: wheels that roll on the ground, turn on shafts and are steered.

Motion of the base, springs and contacts come in, forces go out; all vectors are in the base frame.
To the backend, wheels are spheres without friction that slide on springs: turning, grip and
steering are here.
"""

from collections.abc import Sequence
from math import cos, radians, sin, sqrt
from typing import NamedTuple

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.fields import Vector3
from groundlink.messages.ground_truth import BatteryState
from groundlink.scenario.running_gear import Ackermann, Wheel
from groundlink.scenario.vehicle import VehicleModel
from services.physics.dynamics.memory import PartWithMemory

from .controller import WheelTargets
from .motor import BatteryCharge, Motors, UnlimitedSupply
from .shaft import TurningShaft
from .tire import CreepingTire, Tire


class SteeringJoint:
    """The joint of one steered wheel, straight ahead at first.

    It turns within the speed, torque and range of its drive. The tire's footprint resists, a strip
    as long as the wheel is wide. At standstill all of its points rub; the faster the wheel rolls,
    the less it resists.
    """

    MEMORY = ("angle_rad", "speed_radps")

    __slots__ = (
        "_inertia",
        "_lever_m",
        "_most_nm",
        "_most_radps",
        "_range",
        "angle_rad",
        "speed_radps",
    )

    def __init__(self, wheel: Wheel, drive: Ackermann) -> None:
        self._range = radians(drive.max_steering_deg)
        self._most_radps = radians(drive.steering_speed_degps)
        self._most_nm = drive.steering_torque_nm
        self._inertia = wheel.mass_kg * (3 * wheel.radius_m**2 + wheel.width_m**2) / 12
        # Mean distance of the strip's points from its middle.
        self._lever_m = wheel.width_m / 4
        self.angle_rad = self.speed_radps = 0.0

    def turn(self, asked_rad: float, grip_n: float, rolling_mps: float) -> None:
        """Advance by a tick.

        Parameters
        ----------
        grip_n
            friction times load of the tire.
        rolling_mps
            speed of rolling.
        """
        asked_rad = max(-self._range, min(self._range, asked_rad))
        speed = (asked_rad - self.angle_rad) / TICK_SECONDS
        speed = max(-self._most_radps, min(self._most_radps, speed))
        if speed == self.speed_radps == 0.0:
            return
        scrub = self._lever_m * max(abs(self.speed_radps), abs(speed))
        resisting = grip_n * self._lever_m * scrub / (scrub + abs(rolling_mps))
        lost = resisting * TICK_SECONDS / self._inertia
        # Change of speed to reach the target against the footprint's resistance.
        change = speed - self.speed_radps + (lost if speed > 0.0 else -lost if speed < 0.0 else 0.0)
        most = self._most_nm * TICK_SECONDS / self._inertia
        reached = self.speed_radps + max(-most, min(most, change))
        reached -= max(-lost, min(lost, reached))
        self.speed_radps = reached
        angle = self.angle_rad + reached * TICK_SECONDS
        self.angle_rad = max(-self._range, min(self._range, angle))


def steering_joints(model: VehicleModel) -> dict[str, SteeringJoint]:
    """Return the steering joints of a vehicle by wheel, in the order of its drive."""
    drive = model.drive
    if not isinstance(drive, Ackermann):
        return {}
    wheels = {wheel.name: wheel for wheel in model.wheels}
    return {name: SteeringJoint(wheels[name], drive) for name in drive.steered}


UPRIGHT = 0.2
"""Sine of the angle between axle and ground's normal below which a wheel lies on its side."""

GroundContact = tuple[float, float, float, float]
"""Sums over a wheel's contact points: normal force times the ground's coefficient of friction, N,
and the normal forces on the wheel, N, in the base frame."""


class GroundReaction(NamedTuple):
    """Force and torque of the ground on the base, through the wheels."""

    force_n: Vector3
    torque_nm: Vector3
    """About the center of mass."""

    along_springs_n: list[float]
    """Each wheel's force along its spring, which acts on the wheel and not on the base."""


class RollingWheel:
    """One wheel of the running gear."""

    __slots__ = (
        "friction",
        "ratio",
        "resistance",
        "shaft",
        "steering_joint",
        "tire",
        "x_y_z_radius",
    )

    def __init__(self, wheel: Wheel, tire: Tire, steering_joint: SteeringJoint | None) -> None:
        self.x_y_z_radius = *wheel.center_m, wheel.radius_m
        self.friction = wheel.friction
        self.resistance = wheel.rolling_resistance
        self.tire = tire
        self.steering_joint = steering_joint
        self.shaft: TurningShaft | None = None
        self.ratio = 1.0
        """Turns of the wheel for one turn of its shaft."""

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


def _tire(model: VehicleModel, wheel: Wheel, borne_kg: float) -> Tire:
    ratio = wheel.axle_friction_ratio
    if model.tire_slip:
        return CreepingTire(model.tire_slip, borne_kg=borne_kg, axle_ratio=ratio)
    return Tire(borne_kg=borne_kg, axle_ratio=ratio)


class RunningGear:
    """The wheels of one vehicle, at rest.

    Parameters
    ----------
    borne_kg
        the mass that rests on each wheel on level ground.
    """

    MEMORY = ("_voltage_share", "driving_w", "braking_w")

    def __init__(self, model: VehicleModel, borne_kg: Sequence[float]) -> None:
        self._com = model.chassis.center_m
        self._motors = Motors(model.drive)
        self._charge = BatteryCharge(model.battery) if model.battery else None
        self._source = self._charge or UnlimitedSupply()
        self._voltage_share = 1.0
        joints = steering_joints(model)
        self._steering_joints = tuple(joints.values())
        self.wheels = [
            RollingWheel(
                wheel,
                _tire(model, wheel, mass),
                joints.get(wheel.name),
            )
            for wheel, mass in zip(model.wheels, borne_kg, strict=True)
        ]
        self._driven: list[TurningShaft] = []
        self._free: list[TurningShaft] = []
        for shaft in model.drive.shafts(model.wheels):
            parts = [(model.wheels[i], self.wheels[i]) for i in shaft.wheels]
            for wheel, rolling in parts:
                rolling.ratio = shaft.radius_m / wheel.radius_m
            turning = TurningShaft(
                [rolling.tire for _, rolling in parts],
                radius_m=shaft.radius_m,
                inertia_kgm2=shaft.inertia_kgm2
                + sum(w.axle_inertia_kgm2 * rolling.ratio**2 for w, rolling in parts),
                damping_nmsprad=sum(
                    w.axle_damping_nmsprad * rolling.ratio**2 for w, rolling in parts
                ),
            )
            for _, rolling in parts:
                rolling.shaft = turning
            (self._driven if shaft.driven else self._free).append(turning)
        self._no_torques = (None,) * len(self._driven)
        self.driving_w = self.braking_w = 0.0
        """Mechanical power of the motors in the last tick, driving and braking."""

    def parts(self) -> list[PartWithMemory]:
        """Return the gear and all of its parts that have inner state."""
        tires = (wheel.tire for wheel in self.wheels)
        charge = [self._charge] if self._charge else []
        return [self, *self._driven, *self._free, *tires, *self._steering_joints, *charge]

    def angles(self) -> tuple[float, ...]:
        """Return the angles of the steered wheels."""
        return tuple(steering_joint.angle_rad for steering_joint in self._steering_joints)

    def roll(self, forward_mps: float, turn_radps: float) -> None:
        """Have all shafts turn as they do when the vehicle rolls at a velocity, without slip.

        Parameters
        ----------
        forward_mps, turn_radps
            velocities of the base's origin, along x and about z of the base.
        """
        rolling: dict[TurningShaft, list[float]] = {}
        for wheel in self.wheels:
            if wheel.shaft:
                _, y, _, _ = wheel.x_y_z_radius
                rolling.setdefault(wheel.shaft, []).append(forward_mps - turn_radps * y)
        for shaft, speeds_mps in rolling.items():
            shaft.roll(sum(speeds_mps) / len(speeds_mps))

    def steering_speeds(self) -> tuple[float, ...]:
        """Return the speeds at which the steered wheels are turned, rad/s."""
        return tuple(steering_joint.speed_radps for steering_joint in self._steering_joints)

    def battery(self) -> BatteryState | None:
        """Return the state of the battery, None without one."""
        if (charge := self._charge) is None:
            return None
        return BatteryState(charge.share, charge.voltage_v, charge.current_a)

    def go(
        self,
        asked: WheelTargets,
        *,
        velocity: Vector3,
        turn: Vector3,
        springs: Sequence[Sequence[float]],
        contacts: Sequence[GroundContact | None],
    ) -> GroundReaction:
        """Turn shafts and steering joints for a tick; return the ground's reaction.

        Parameters
        ----------
        velocity, turn
            velocities of the base's origin, m/s and rad/s.
        springs
            position (m) and velocity (m/s) of each wheel along the base's z.
        contacts
            of each wheel with the ground; None in the air.
        """
        vx, vy, vz = velocity
        ox, oy, oz = turn
        steer = dict(zip(self._steering_joints, asked.angles_rad, strict=True))
        meeting: list[tuple[float, ...] | None] = []
        for wheel, spring, contact in zip(self.wheels, springs, contacts, strict=True):
            steering_joint = wheel.steering_joint
            if contact is None:
                wheel.tire.lift()
                if steering_joint:
                    steering_joint.turn(steer[steering_joint], 0.0, 0.0)
                meeting.append(None)
                continue
            grip, nx, ny, nz = contact
            load = sqrt(nx * nx + ny * ny + nz * nz) or 1.0  # forces on a wedged wheel cancel
            nx, ny, nz = nx / load, ny / load, nz / load
            grip *= wheel.friction
            ax, ay = 0.0, 1.0
            if steering_joint:
                steering_joint.turn(steer[steering_joint], grip, vx)
                ax, ay = -sin(steering_joint.angle_rad), cos(steering_joint.angle_rad)
            # Forward and left along the ground; the axle is (ax, ay, 0).
            fx, fy, fz = ay * nz, -ax * nz, ax * ny - ay * nx
            size = sqrt(fx * fx + fy * fy + fz * fz)
            if size < UPRIGHT:
                grip, size = 0.0, 1.0
            fx, fy, fz = fx / size, fy / size, fz / size
            lx, ly, lz = ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx
            x, y, z, radius = wheel.x_y_z_radius
            x, y, z = x - radius * nx, y - radius * ny, z + spring[0] - radius * nz
            px, py = vx + oy * z - oz * y, vy + oz * x - ox * z
            pz = vz + ox * y - oy * x + spring[1]
            wheel.tire.meet(
                fx * px + fy * py + fz * pz,
                lx * px + ly * py + lz * pz,
                grip,
                wheel.resistance * load,
                load,
            )
            meeting.append((fx, fy, fz, lx, ly, lz, x, y, z))
        spin = self._turn_shafts(asked.speeds_radps, asked.torques_nm or self._no_torques)
        cx, cy, cz = self._com
        sx = sy = sz = tx = tz = 0.0
        ty = -spin
        along_springs = []
        for wheel, met in zip(self.wheels, meeting, strict=True):
            if met is None:
                along_springs.append(0.0)
                continue
            fx, fy, fz, lx, ly, lz, x, y, z = met
            along, aside = wheel.tire.settle(wheel.shaft.tread_mps if wheel.shaft else 0.0)
            fx, fy, fz = along * fx + aside * lx, along * fy + aside * ly, along * fz + aside * lz
            sx, sy, sz = sx + fx, sy + fy, sz + fz
            x, y, z = x - cx, y - cy, z - cz
            tx += y * fz - z * fy
            ty += z * fx - x * fz
            tz += x * fy - y * fx
            along_springs.append(fz)
        return GroundReaction((sx, sy, sz), (tx, ty, tz), along_springs)

    def _turn_shafts(self, speeds: Sequence[float], torques: Sequence[float | None]) -> float:
        """Turn all shafts for a tick; return the rate of their angular momentum about y, N m.

        Its reaction turns the base the other way.
        """
        share, motors = self._voltage_share, self._motors
        drawn = self.driving_w = self.braking_w = 0.0
        rate = 0.0
        for shaft, asked, torque in zip(self._driven, speeds, torques, strict=True):
            before = shaft.speed_radps
            least, most = motors.limits_nm(before, share)
            if torque is not None:
                # Toward the target speed at most the commanded torque; a brake at that speed.
                least, most = (
                    (max(least, torque), most) if asked < 0 else (least, min(most, torque))
                )
            shaft.turn(asked, least, most)
            rate += shaft.inertia_kgm2 * (shaft.speed_radps - before)
            speed = (before + shaft.speed_radps) / 2
            drawn += motors.power_w(shaft.torque_nm, speed)
            power = shaft.torque_nm * speed
            if power > 0.0:
                self.driving_w += power
            else:
                self.braking_w -= power
        for shaft in self._free:
            before = shaft.speed_radps
            shaft.turn(0.0, 0.0, 0.0)
            rate += shaft.inertia_kgm2 * (shaft.speed_radps - before)
        self._voltage_share = self._source.draw(drawn)
        return rate / TICK_SECONDS
