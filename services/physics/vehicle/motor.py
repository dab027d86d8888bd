# SPDX-License-Identifier: Apache-2.0
"""Motors and battery: torque limits at a speed, power, and charge.

The torque of a direct-current motor with stall torque T and no-load speed w0 at full voltage falls
in a line with its speed; less voltage moves the line down in parallel. Heat in its windings follows
from the same two figures: holding a torque t costs t^2 w0 / T.
"""

from math import sqrt

from groundlink.core.clock import TICK_SECONDS
from groundlink.scenario.running_gear import Battery, DriveSpec


class Motors:
    """The motors of a vehicle, all of one kind."""

    def __init__(self, drive: DriveSpec) -> None:
        self._most_nm = drive.max_wheel_torque_nm
        self._motor = drive.motor

    def limits_nm(self, speed_radps: float, voltage_share: float) -> tuple[float, float]:
        """Return the least and the most torque at a speed, with a share of the full voltage."""
        most, motor = self._most_nm, self._motor
        if motor is None:
            return (-most, most) if voltage_share > 0.0 else (0.0, 0.0)
        stall, slowing = motor.stall_torque_nm, speed_radps / motor.no_load_speed_radps
        return (
            -max(0.0, min(most, stall * (voltage_share + slowing))),
            max(0.0, min(most, stall * (voltage_share - slowing))),
        )

    def power_w(self, torque_nm: float, speed_radps: float) -> float:
        """Return the power that a motor draws, work and heat; braking returns nothing."""
        power = torque_nm * speed_radps
        if (motor := self._motor) is not None:
            power += torque_nm * torque_nm * motor.no_load_speed_radps / motor.stall_torque_nm
        return max(0.0, power)


class BatteryCharge:
    """Charge of a vehicle's battery."""

    MEMORY = ("share", "current_a", "voltage_v")

    def __init__(self, battery: Battery) -> None:
        self._battery = battery
        self.share = battery.charge
        """Share of the capacity."""

        self.current_a = 0.0
        self.voltage_v = self._open_v

    @property
    def _open_v(self) -> float:
        full, empty = self._battery.full_v, self._battery.empty_v
        return empty + self.share * (full - empty)

    def draw(self, power_w: float) -> float:
        """Draw power for a tick; return the voltage as a share of the full one.

        The current I solves (V - I R) I = P. Where the battery cannot give P, it gives its maximum.
        """
        battery = self._battery
        if self.share <= 0.0:
            self.current_a = self.voltage_v = 0.0
            return 0.0
        power, volts, ohms = power_w + battery.idle_power_w, self._open_v, battery.resistance_ohm
        if ohms > 0.0:
            root = sqrt(max(0.0, volts * volts - 4 * ohms * power))
            self.current_a = (volts - root) / (2 * ohms)
        else:
            self.current_a = power / volts
        used = self.current_a * TICK_SECONDS / 3600 / battery.capacity_ah
        self.share = max(0.0, self.share - used)
        self.voltage_v = volts - self.current_a * ohms
        return self.voltage_v / battery.full_v


class UnlimitedSupply:
    """Supplies a vehicle without a battery: never empty."""

    def draw(self, power_w: float) -> float:
        """Return the full voltage."""
        return 1.0
