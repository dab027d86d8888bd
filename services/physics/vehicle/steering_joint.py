# SPDX-License-Identifier: Apache-2.0
"""Steering joint of a wheel: turns within the speed, torque and range of its drive.

The tire's footprint resists, a strip as long as the wheel is wide. At standstill all of its points
rub; the faster the wheel rolls, the less it resists.
"""

from math import radians

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.running_gear import Ackermann, Wheel
from groundlink.scenario.vehicle import VehicleModel


class SteeringJoint:
    """The joint of one steered wheel, straight ahead at first."""

    __slots__ = ("_inertia", "_lever_m", "_most_nm", "_most_radps", "_range", "_speed", "angle_rad")

    def __init__(self, wheel: Wheel, drive: Ackermann) -> None:
        self._range = radians(drive.max_steering_deg)
        self._most_radps = radians(drive.steering_speed_degps)
        self._most_nm = drive.steering_torque_nm
        self._inertia = wheel.mass_kg * (3 * wheel.radius_m**2 + wheel.width_m**2) / 12
        # Mean distance of the strip's points from its middle.
        self._lever_m = wheel.width_m / 4
        self.angle_rad = self._speed = 0.0

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
        if speed == self._speed == 0.0:
            return
        scrub = self._lever_m * max(abs(self._speed), abs(speed))
        resisting = grip_n * self._lever_m * scrub / (scrub + abs(rolling_mps))
        lost = resisting * TICK_SECONDS / self._inertia
        # Change of speed to reach the target against the footprint's resistance.
        change = speed - self._speed + (lost if speed > 0.0 else -lost if speed < 0.0 else 0.0)
        most = self._most_nm * TICK_SECONDS / self._inertia
        reached = self._speed + max(-most, min(most, change))
        reached -= max(-lost, min(lost, reached))
        self._speed = reached
        angle = self.angle_rad + reached * TICK_SECONDS
        self.angle_rad = max(-self._range, min(self._range, angle))


def steering_joints(model: VehicleModel) -> dict[str, SteeringJoint]:
    """Return the steering joints of a vehicle by wheel, in the order of its drive."""
    drive = model.drive
    if not isinstance(drive, Ackermann):
        return {}
    wheels = {wheel.name: wheel for wheel in model.wheels}
    return {name: SteeringJoint(wheels[name], drive) for name in drive.steered}
