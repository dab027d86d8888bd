# SPDX-License-Identifier: Apache-2.0
"""What the drive asks of the wheels, and when."""

import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Command, WheelCommand
from groundlink.scenario import Scenario
from groundlink.scenario.running_gear import Motor
from groundlink.scenario.vehicle import VehicleModel
from services.physics.vehicle.controller import MAX_WAITING, Controller, WheelTargets
from services.physics.vehicle.steering import steering

STILL = (0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def model(lab: Scenario) -> VehicleModel:
    """Return the rover's model, with a controller that knows no ramps."""
    model = lab.vehicles[0].model
    quick = {"max_acceleration_mps2": 1e9, "max_angular_acceleration_radps2": 1e9}
    return replace(model, drive=replace(model.drive, **quick))


def twist(stamp_nanos: int, linear: float, angular: float = 0.0) -> Command:
    return Command(stamp_nanos, (linear, 0.0, 0.0), (0.0, 0.0, angular))


def speeds(drive: Controller, sim_nanos: int) -> tuple[float, ...]:
    return drive.wheels(sim_nanos).speeds_radps


def wheel_speeds(model: VehicleModel, twist: tuple[float, float]) -> tuple[float, ...]:
    return steering(model).speeds(twist)


@pytest.mark.parametrize("epoch_nanos", [0, 1_700_000_000_000_000_000])
def test_a_command_acts_from_its_stamp_until_the_timeout(
    model: VehicleModel, epoch_nanos: int
) -> None:
    drive = Controller(model, epoch_nanos=epoch_nanos)
    stamp = 10 * TICK_NANOS
    drive.command(twist(epoch_nanos + stamp, 0.5))
    assert speeds(drive, stamp - TICK_NANOS) == STILL
    moving = wheel_speeds(model, (0.5, 0.0))
    assert speeds(drive, stamp) == moving
    assert speeds(drive, stamp + 500_000_000) == moving
    assert speeds(drive, stamp + 500_000_000 + TICK_NANOS) == STILL


def test_an_older_command_changes_nothing(model: VehicleModel) -> None:
    drive = Controller(model)
    drive.command(twist(100, 0.5))
    before = speeds(drive, 200)
    drive.command(twist(50, -0.5))
    assert speeds(drive, 300) == before


def test_commands_act_in_the_order_of_their_stamps(model: VehicleModel) -> None:
    drive = Controller(model)
    for stamp, linear in ((300, 0.3), (100, 0.1), (200, 0.2)):
        drive.command(twist(stamp, linear))
    for now, linear in ((150, 0.1), (250, 0.2), (350, 0.3)):
        assert speeds(drive, now) == wheel_speeds(model, (linear, 0.0))


def test_of_two_commands_of_one_instant_the_later_one_counts(model: VehicleModel) -> None:
    drive = Controller(model)
    drive.command(twist(0, 0.5))
    drive.command(twist(0, 0.1))
    assert speeds(drive, 0) == wheel_speeds(model, (0.1, 0.0))


def test_a_flood_from_the_future_is_refused(model: VehicleModel) -> None:
    drive = Controller(model)
    for stamp in range(MAX_WAITING):
        drive.command(twist(10**18 + stamp, 0.5))
    with pytest.raises(ValueError, match="future"):
        drive.command(twist(10**18, 0.5))


def test_stale_commands_change_nothing_and_leave_room_for_a_new_one(model: VehicleModel) -> None:
    """They come in a burst when who sends them was cut off."""
    drive = Controller(model)
    now = 2_000_000_000
    assert drive.command(twist(now, 0.5))
    before = speeds(drive, now)
    for stamp in range(MAX_WAITING + 1):
        assert not drive.command(twist(stamp, -0.5))
    assert speeds(drive, now + TICK_NANOS) == before
    assert drive.command(twist(now + 2 * TICK_NANOS, 0.25))
    assert speeds(drive, now + 2 * TICK_NANOS) == wheel_speeds(model, (0.25, 0.0))


def test_velocity_ramps(lab: Scenario) -> None:
    model = lab.vehicles[0].model
    drive = Controller(model)
    drive.command(twist(0, 1.0))
    ramp = [speeds(drive, tick * TICK_NANOS)[0] * 0.1651 for tick in range(200)]
    per_tick = model.drive.max_acceleration_mps2 * TICK_NANOS * 1e-9
    assert ramp[:3] == pytest.approx([per_tick, 2 * per_tick, 3 * per_tick])
    assert ramp[-1] == pytest.approx(1.0)
    assert max(ramp) <= 1.0 + 1e-12


def test_motor_latency_delays_commands(model: VehicleModel) -> None:
    slow = Motor(stall_torque_nm=1.0, no_load_speed_radps=1.0, latency_s=0.05)
    drive = Controller(replace(model, drive=replace(model.drive, motor=slow)))
    drive.command(twist(0, 0.5))
    assert speeds(drive, 50_000_000 - TICK_NANOS) == STILL
    assert speeds(drive, 50_000_000) == wheel_speeds(model, (0.5, 0.0))


def test_wheels_can_be_commanded_one_by_one(model: VehicleModel) -> None:
    drive = Controller(model)
    names = [wheel.name for wheel in model.wheels]
    drive.command(WheelCommand(0, {names[0]: 1.0, names[3]: -99.0}))
    most = model.drive.max_wheel_speed_radps
    assert drive.wheels(0) == WheelTargets((1.0, 0.0, 0.0, -most), ())
    drive.command(twist(TICK_NANOS, 0.5))
    assert speeds(drive, TICK_NANOS) == wheel_speeds(model, (0.5, 0.0))
    drive.command(WheelCommand(2 * TICK_NANOS, {names[0]: 1.0}))
    assert speeds(drive, 2 * TICK_NANOS) == (1.0, 0.0, 0.0, 0.0)
    assert speeds(drive, 600_000_000) == STILL


@pytest.mark.parametrize(
    ("speeds", "angles", "says"),
    [
        ({"front_left_whel": 1.0}, {}, "`front_left_whel` takes no command"),
        ({}, {"front_left_wheel": 0.1}, "`front_left_wheel` takes no command"),
        ({"front_left_wheel": float("nan")}, {}, "finite"),
    ],
)
def test_commands_of_wheels_that_cannot_be_are_refused(
    model: VehicleModel, speeds: dict[str, float], angles: dict[str, float], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        Controller(model).command(WheelCommand(0, speeds, angles))
