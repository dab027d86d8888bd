# SPDX-License-Identifier: Apache-2.0
"""Motors and what feeds them."""

import pytest

from groundlink.scenario.running_gear import Battery, Motor, SkidSteer
from services.physics.running_gear.motor import BatteryCharge, Motors

DRIVE = SkidSteer(max_wheel_torque_nm=15.0, max_wheel_speed_radps=10.0)
MOTOR = Motor(stall_torque_nm=20.0, no_load_speed_radps=10.0)
BATTERY = Battery(capacity_ah=1.0, full_v=24.0, empty_v=20.0, resistance_ohm=0.1)


def motors(motor: Motor | None = MOTOR) -> Motors:
    return Motors(SkidSteer(max_wheel_torque_nm=15.0, max_wheel_speed_radps=10.0, motor=motor))


@pytest.mark.parametrize(
    ("speed", "share", "least", "most"),
    [
        (0.0, 1.0, -15.0, 15.0),
        (5.0, 1.0, -15.0, 10.0),
        (10.0, 1.0, -15.0, 0.0),
        (12.0, 1.0, -15.0, 0.0),
        (-5.0, 1.0, -10.0, 15.0),
        (0.0, 0.5, -10.0, 10.0),
        (4.0, 0.5, -15.0, 2.0),
    ],
)
def test_torque_falls_in_a_line_with_speed_and_voltage(
    speed: float, share: float, least: float, most: float
) -> None:
    assert motors().limits_nm(speed, share) == pytest.approx((least, most))


def test_without_a_motor_model_torque_is_what_the_drive_allows() -> None:
    assert motors(None).limits_nm(9.0, 0.8) == (-15.0, 15.0)
    assert motors(None).limits_nm(9.0, 0.0) == (0.0, 0.0)


def test_to_hold_costs_heat_and_to_drive_work_besides() -> None:
    assert motors().power_w(10.0, 0.0) == pytest.approx(100.0 * 10.0 / 20.0)
    assert motors().power_w(10.0, 5.0) == pytest.approx(50.0 + 50.0)
    assert motors().power_w(2.0, -9.0) == 0.0
    assert motors(None).power_w(10.0, 5.0) == 50.0


def test_a_battery_empties_by_the_current() -> None:
    charge = BatteryCharge(BATTERY)
    # 23 V at 10 A: what the resistance leaves of 24 V.
    share = charge.draw(230.0)
    assert (charge.current_a, charge.voltage_v) == pytest.approx((10.0, 23.0))
    assert share == pytest.approx(23.0 / 24.0)
    assert charge.share == pytest.approx(1.0 - 10.0 * 0.0025 / 3600)


def test_an_empty_battery_gives_nothing() -> None:
    charge = BatteryCharge(Battery(capacity_ah=1e-6, full_v=24.0, empty_v=20.0, idle_power_w=1.0))
    shares = [charge.draw(10.0) for _ in range(100)]
    assert shares[0] > 0.8
    assert (shares[-1], charge.share, charge.current_a) == (0.0, 0.0, 0.0)


def test_a_battery_gives_no_more_than_it_can() -> None:
    charge = BatteryCharge(BATTERY)
    assert charge.draw(1e6) == pytest.approx(0.5)
    assert charge.current_a == pytest.approx(120.0)
