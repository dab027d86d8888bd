# SPDX-License-Identifier: Apache-2.0
"""What the drive asks of the wheels, and when."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from groundlink.clock import TICK_NANOS
from groundlink.messages import Command
from groundlink.scenario import Scenario
from groundlink.scenario.vehicle import VehicleModel
from services.physics.drive import MAX_WAITING, SkidSteering, wheel_speeds, within_limits

STILL = (0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def model(lab: Scenario) -> VehicleModel:
    """Return the rover's model, with a controller that knows no ramps."""
    model = lab.vehicles[0].model
    quick = {"max_acceleration_mps2": 1e9, "max_angular_acceleration_radps2": 1e9}
    return replace(model, drive=replace(model.drive, **quick))


def twist(stamp_nanos: int, linear: float, angular: float = 0.0) -> Command:
    return Command(stamp_nanos, (linear, 0.0, 0.0), (0.0, 0.0, angular))


def test_straight_on_all_wheels_turn_alike(model: VehicleModel) -> None:
    assert wheel_speeds(model, (0.5, 0.0)) == pytest.approx([0.5 / 0.1651] * 4)


def test_to_the_left_the_right_wheels_turn_forward(model: VehicleModel) -> None:
    speed = 0.2854 * model.drive.track_multiplier / 0.1651
    left_right_left_right = [-speed, speed, -speed, speed]
    assert wheel_speeds(model, (0.0, 1.0)) == pytest.approx(left_right_left_right)


@pytest.mark.parametrize("asked", [(9.0, 0.0), (-9.0, 0.0), (0.0, 50.0), (3.0, 4.0), (1e300, 1.0)])
def test_too_fast_is_slowed_on_the_same_curve(
    model: VehicleModel, asked: tuple[float, float]
) -> None:
    linear, angular = within_limits(model, asked)
    fastest = max(map(abs, wheel_speeds(model, (linear, angular))))
    assert fastest == pytest.approx(model.drive.max_wheel_speed_radps)
    assert linear * asked[1] == pytest.approx(angular * asked[0])


@pytest.mark.parametrize("epoch_nanos", [0, 1_700_000_000_000_000_000])
def test_a_command_acts_from_its_stamp_until_the_timeout(
    model: VehicleModel, epoch_nanos: int
) -> None:
    drive = SkidSteering(model, epoch_nanos=epoch_nanos)
    stamp = 10 * TICK_NANOS
    drive.command(twist(epoch_nanos + stamp, 0.5))
    assert drive.speeds(stamp - TICK_NANOS) == STILL
    moving = wheel_speeds(model, (0.5, 0.0))
    assert drive.speeds(stamp) == moving
    assert drive.speeds(stamp + 500_000_000) == moving
    assert drive.speeds(stamp + 500_000_000 + TICK_NANOS) == STILL


def test_an_older_command_changes_nothing(model: VehicleModel) -> None:
    drive = SkidSteering(model)
    drive.command(twist(100, 0.5))
    before = drive.speeds(200)
    drive.command(twist(50, -0.5))
    assert drive.speeds(300) == before


def test_commands_act_in_the_order_of_their_stamps(model: VehicleModel) -> None:
    drive = SkidSteering(model)
    for stamp, linear in ((300, 0.3), (100, 0.1), (200, 0.2)):
        drive.command(twist(stamp, linear))
    for now, linear in ((150, 0.1), (250, 0.2), (350, 0.3)):
        assert drive.speeds(now) == wheel_speeds(model, (linear, 0.0))


def test_of_two_commands_of_one_instant_the_later_one_counts(model: VehicleModel) -> None:
    drive = SkidSteering(model)
    drive.command(twist(0, 0.5))
    drive.command(twist(0, 0.1))
    assert drive.speeds(0) == wheel_speeds(model, (0.1, 0.0))


def test_a_flood_from_the_future_is_refused(model: VehicleModel) -> None:
    drive = SkidSteering(model)
    for stamp in range(MAX_WAITING):
        drive.command(twist(10**18 + stamp, 0.5))
    with pytest.raises(ValueError, match="future"):
        drive.command(twist(10**18, 0.5))


def test_velocity_ramps(lab: Scenario) -> None:
    model = lab.vehicles[0].model
    drive = SkidSteering(model)
    drive.command(twist(0, 1.0))
    ramp = [drive.speeds(tick * TICK_NANOS)[0] * 0.1651 for tick in range(200)]
    per_tick = model.drive.max_acceleration_mps2 * TICK_NANOS * 1e-9
    assert ramp[:3] == pytest.approx([per_tick, 2 * per_tick, 3 * per_tick])
    assert ramp[-1] == pytest.approx(1.0)
    assert max(ramp) <= 1.0 + 1e-12
