# SPDX-License-Identifier: Apache-2.0
"""Motors and battery: torque limits at a speed, power, and charge.

The torque of a direct-current motor with stall torque T and no-load speed w0 at full voltage falls
in a line with its speed; less voltage moves the line down in parallel. Heat in its windings follows
from the same two figures: holding a torque t costs t^2 w0 / T. `motor.c` computes them.
"""

from ctypes import Structure, byref, c_double

from groundlink.scenario.running_gear import Battery, DriveSpec
from services.physics.dynamics.kernels import kernels


class Motors(Structure):
    """The motors of a vehicle, all of one kind."""

    _fields_ = (("_most_nm", c_double), ("_stall_nm", c_double), ("_no_load_radps", c_double))

    def __init__(self, drive: DriveSpec) -> None:
        super().__init__(drive.max_wheel_torque_nm)
        if (motor := drive.motor) is not None:
            self._stall_nm = motor.stall_torque_nm
            self._no_load_radps = motor.no_load_speed_radps

    def limits_nm(self, speed_radps: float, voltage_share: float) -> tuple[float, float]:
        """Return the least and the most torque at a speed, with a share of the full voltage."""
        limits = (c_double * 2)()
        kernels().motors_limits(byref(self), speed_radps, voltage_share, limits)
        return limits[0], limits[1]

    def power_w(self, torque_nm: float, speed_radps: float) -> float:
        """Return the power that a motor draws, work and heat; braking returns nothing."""
        power: float = kernels().motors_power(byref(self), torque_nm, speed_radps)
        return power


class BatteryCharge(Structure):
    """Charge of a vehicle's battery."""

    MEMORY = ("share", "current_a", "voltage_v")

    _fields_ = (
        ("_capacity_ah", c_double),
        ("_full_v", c_double),
        ("_empty_v", c_double),
        ("_resistance_ohm", c_double),
        ("_idle_power_w", c_double),
        ("share", c_double),
        ("current_a", c_double),
        ("voltage_v", c_double),
    )
    share: float
    """Share of the capacity."""

    current_a: float
    voltage_v: float

    def __init__(self, battery: Battery) -> None:
        full, empty = battery.full_v, battery.empty_v
        super().__init__(
            *(battery.capacity_ah, full, empty, battery.resistance_ohm, battery.idle_power_w),
            *(battery.charge, 0.0, empty + battery.charge * (full - empty)),
        )

    def draw(self, power_w: float) -> float:
        """Draw power for a tick; return the voltage as a share of the full one.

        The current I solves (V - I R) I = P. Where the battery cannot give P, it gives its maximum.
        """
        share: float = kernels().battery_draw(byref(self), power_w)
        return share
