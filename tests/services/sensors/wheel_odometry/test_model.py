# SPDX-License-Identifier: Apache-2.0
"""Odometry by wheels: what it makes of ticks, and how it compares with the truth of physics."""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import (
    Command,
    Imu,
    State,
    VehicleState,
    encode,
    floats,
)
from groundlink.messages.navigation import Odometry
from groundlink.scenario import Scenario
from groundlink.scenario.running_gear import Differential
from groundlink.scenario.schema import Vehicle
from groundlink.scene.build import solids
from services.physics.simulation.simulation import Simulation
from services.sensors.encoders.spec import Encoders
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import InertialUnit
from services.sensors.wheel_odometry.model import UNKNOWN, WheelOdometryModel
from services.sensors.wheel_odometry.spec import WheelOdometry
from tests.services.sensors.states import EPOCH_NANOS, WHEELS, scenario, states

RADIUS_M, TRACK_M = 0.1, 0.5
ENCODERS = Encoders(name="wheels", topic="/wheels", frame="base_link")
KNOWN = (0, 1, 5)


def cart(*given: Encoders, seed: int = 1, frame_prefix: str = "") -> tuple[Scenario, Vehicle]:
    run = scenario(seed=seed, frame_prefix=frame_prefix)
    vehicle = run.vehicles[0]
    wheels = tuple(
        replace(wheel, center_m=(0.0, side * TRACK_M / 2, 0.0), radius_m=RADIUS_M)
        for wheel, side in zip(vehicle.model.wheels, (1, -1), strict=True)
    )
    model = replace(vehicle.model, wheels=wheels)
    return run, replace(vehicle, model=model, sensors=given or (ENCODERS,))


def odometry(
    *given: Encoders, seed: int = 1, frame_prefix: str = "", **fields: Any
) -> WheelOdometryModel:
    run, vehicle = cart(*given, seed=seed, frame_prefix=frame_prefix)
    told = {"encoders": "wheels", "rate_hz": 50.0} | fields
    spec = WheelOdometry(name="odom", topic="/odom", frame="odom", **told)
    return WheelOdometryModel(run, vehicle, spec)


def rolled(left_m: Any, right_m: Any, **fields: Any) -> list[State]:
    """Return states of wheels that have rolled so far, one a tick."""
    angles = np.stack([left_m, right_m], axis=1) / RADIUS_M
    return list(states(np.zeros((len(angles), 3)), joint_positions=angles, **fields))


def readings(model: WheelOdometryModel, run: Iterable[State]) -> list[Odometry]:
    return [reading for state in run for reading in model.readings(state)]


def yaw(reading: Odometry) -> float:
    x, y, z, w = reading.orientation
    assert (x, y) == (0.0, 0.0)
    return 2 * math.atan2(z, w)


def covariance(packed: memoryview) -> NDArray[np.float64]:
    return floats(packed).reshape(6, 6)


# By ticks


def test_on_a_straight_it_counts_the_way() -> None:
    way = 0.5 * np.arange(801) / 400
    taken = readings(odometry(), rolled(way, way))
    assert len(taken) == 101
    for reading in taken:
        expected = 0.5 * (reading.stamp_nanos - EPOCH_NANOS) * 1e-9
        assert reading.position_m[0] == pytest.approx(expected, abs=2e-4)  # A tick is 0.15 mm.
        assert reading.position_m[1:] == (0.0, 0.0)
        assert yaw(reading) == 0
    assert taken[-1].linear_mps[0] == pytest.approx(0.5, rel=0.02)
    assert taken[-1].angular_radps == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("multiplier", [None, 1.8])
def test_in_a_turn_the_effective_track_counts(multiplier: float | None) -> None:
    turned = 0.8 * np.arange(801) / 400  # By the geometric track, in radians.
    taken = readings(
        odometry(track_multiplier=multiplier),
        rolled(-turned * TRACK_M / 2, turned * TRACK_M / 2),
    )
    assert yaw(taken[-1]) == pytest.approx(1.6 / (multiplier or 1), abs=2e-3)
    assert taken[-1].angular_radps[2] == pytest.approx(0.8 / (multiplier or 1), rel=0.05)


def test_a_base_ahead_of_its_axle_is_carried_round_it() -> None:
    ahead, turned = 0.7, 0.8 * np.arange(801) / 400
    run, vehicle = cart()
    wheels = tuple(
        replace(wheel, center_m=(-ahead, wheel.center_m[1], 0.0)) for wheel in vehicle.model.wheels
    )
    drive = Differential(max_wheel_torque_nm=1.0, max_wheel_speed_radps=100.0)
    placed = replace(vehicle, model=replace(vehicle.model, wheels=wheels, drive=drive))
    spec = WheelOdometry(name="odom", topic="/odom", frame="odom", encoders="wheels")
    model = WheelOdometryModel(run, placed, spec)
    last = readings(model, rolled(-turned * TRACK_M / 2, turned * TRACK_M / 2))[-1]
    assert yaw(last) == pytest.approx(1.6, abs=2e-3)
    x, y = ahead * (math.cos(1.6) - 1), ahead * math.sin(1.6)
    assert last.position_m == pytest.approx((x, y, 0.0), abs=2e-3)
    assert last.linear_mps == pytest.approx((0.0, 0.8 * ahead, 0.0), abs=0.02)
    pose = covariance(last.pose_covariance)
    across = np.array([-math.sin(1.6), math.cos(1.6)]) * ahead
    # Of the little way that its wheels have rolled, nearly all error is that of the heading.
    np.testing.assert_allclose(pose[:2, 5], across * pose[5, 5], atol=0.05 * pose[5, 5])


def test_the_first_reading_is_the_origin_wherever_the_counters_stand() -> None:
    taken = readings(odometry(), rolled([77.0], [-13.0]))
    assert (taken[0].position_m, taken[0].orientation) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert not covariance(taken[0].pose_covariance)[np.ix_(KNOWN, KNOWN)].any()


def test_odometry_uses_its_configured_radius() -> None:
    way = np.linspace(0, 1, 401)
    taken = readings(odometry(wheel_radius_m=2 * RADIUS_M), rolled(way, way))
    assert taken[-1].position_m[0] == pytest.approx(2, abs=1e-3)


def test_what_wheels_do_not_tell_is_unknown() -> None:
    way = np.linspace(0, 1, 401)
    reading = readings(odometry(), rolled(way, way))[-1]
    pose, twist = covariance(reading.pose_covariance), covariance(reading.twist_covariance)
    for matrix, known in ((pose, KNOWN), (twist, (0, 5))):
        assert (np.linalg.eigvalsh(matrix[np.ix_(known, known)]) > 0).all()
        for i in set(range(6)) - set(known):
            assert matrix[i, i] == UNKNOWN
            assert np.count_nonzero(matrix[i]) == np.count_nonzero(matrix[:, i]) == 1
    assert (reading.frame, reading.child_frame) == ("odom", "base_link")


def test_the_rounding_of_two_counts_is_in_its_covariance() -> None:
    """Of a pose whose wheels err by nothing else, over many phases of first and last count."""
    random = np.random.default_rng(5)
    exact = {"travel_stddev": 0.0, "turn_stddev_share": 0.0, "skid_stddev_s": 0.0}
    errors = []
    for _ in range(600):
        begin, way = random.uniform(0, 0.1, 2), random.uniform(0, 0.004, 2)
        left, right = np.stack([begin, begin + way], axis=1)
        last = readings(odometry(rate_hz=400, **exact), rolled(left, right))[-1]
        errors.append([last.position_m[0] - way.mean(), yaw(last) - np.diff(way)[0] / TRACK_M])
        said = covariance(last.pose_covariance)[[0, 5], [0, 5]]
    np.testing.assert_allclose(np.std(errors, axis=0), np.sqrt(said), rtol=0.1)


def test_missed_ticks_shorten_the_way_and_are_those_of_the_encoders() -> None:
    way = np.linspace(0, 1, 401)
    missing = replace(ENCODERS, missed_ticks=0.1)
    taken = readings(odometry(missing), rolled(way, way))
    assert taken[-1].position_m[0] == pytest.approx(0.9, abs=0.01)
    other = readings(odometry(missing, seed=2), rolled(way, way))
    assert encode(other[-1]) != encode(taken[-1])


@pytest.mark.parametrize(
    "encoders",
    [
        replace(ENCODERS, reversed_wheels=(WHEELS[0],)),
        replace(ENCODERS, start_ticks=2**63 - 100),
        replace(ENCODERS, ticks_per_revolution=1024, quadrature=4),
    ],
)
def test_signs_wraps_and_gears_change_nothing(encoders: Encoders) -> None:
    left, right = np.linspace(0, 1, 401), np.linspace(0, 0.8, 401)
    expected = readings(odometry(), rolled(left, right))
    taken = readings(odometry(encoders), rolled(left, right))
    # A counter that is turned round has its lines half open on the other side.
    np.testing.assert_allclose(taken[-1].position_m, expected[-1].position_m, atol=3e-4)
    assert yaw(taken[-1]) == pytest.approx(yaw(expected[-1]), abs=6e-4)


def test_a_reset_costs_one_step_and_no_more() -> None:
    way = np.linspace(0, 1, 801)
    taken = readings(odometry(replace(ENCODERS, resets_s=(1.0,))), rolled(way, way))
    assert taken[-1].position_m[0] == pytest.approx(1 - 1 / 100, abs=1e-3)


def test_counters_that_are_not_there_are_refused() -> None:
    with pytest.raises(UserError, match="`encoders`: expected the name of a sensor of kind"):
        odometry(replace(ENCODERS, name="others"))


def test_after_lost_states_it_goes_on_from_where_it_was() -> None:
    way = np.linspace(0, 1, 401)
    run = rolled(way, way)
    model = odometry()
    readings(model, run[:100])
    model.restart()
    assert readings(model, run[200:])[-1].position_m[0] == pytest.approx(1, abs=1e-3)


# By physics


class Driven(NamedTuple):
    """The end of a drive: its odometry, the true pose of that instant from the start, samples."""

    last: Odometry
    turned_rad: float
    """By odometry, all in all."""

    true_m: tuple[float, float]
    true_turned_rad: float
    speed_mps: float
    """Mean true speed of the second half."""

    samples: list[Imu]
    """Of the second half, of an IMU without errors in the base."""


ROVER = load(SHIPPED / "indoor_lab.yaml")


def rolling(
    run: Scenario, speed_mps: float, turn_radps: float, seconds: float
) -> Iterator[tuple[State, VehicleState]]:
    """Yield the states of a run whose vehicle drives on nothing but a floor, and the vehicle's."""
    vehicle = run.vehicles[0]
    floor = [s for s in solids(run) if s.name == "room_floor"]
    with Simulation(run, floor) as simulation:
        for tick in range(round(seconds * 400) + 1):
            state = State("t", 0, 0, tick, tick * 2_500_000, "", simulation.vehicle_states())
            yield state, state.vehicles[vehicle.name]
            if tick % 20 == 0:
                command = Command(state.sim_nanos, (speed_mps, 0, 0), (0, 0, turn_radps))
                simulation.command(vehicle.name, command)
            simulation.step()


def headings(poses: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return how far the base has turned, in radians, whole turns included."""
    angles: NDArray[np.float64] = np.unwrap([2 * np.arctan2(pose[5], pose[6]) for pose in poses])
    return angles


def drive(speed_mps: float, turn_radps: float, seconds: float, **told: Any) -> Driven:
    run = ROVER
    encoders = next(s for s in run.vehicles[0].sensors if isinstance(s, Encoders))
    vehicle = replace(run.vehicles[0], sensors=(encoders,))
    spec = WheelOdometry(name="odom", topic="/odom", frame="odom", encoders=encoders.name, **told)
    model = WheelOdometryModel(run, vehicle, spec)
    imu = ImuModel(run, vehicle, InertialUnit(name="imu", topic="/imu", frame="i", rate_hz=100))
    taken, felt, poses, speeds = [], [], [], []
    for state, truth in rolling(replace(run, vehicles=(vehicle,)), speed_mps, turn_radps, seconds):
        poses.append(truth.poses()[0])
        speeds.append(np.hypot(*floats(truth.base_velocity)[:2]))
        taken += model.readings(state)
        felt += imu.readings(state)
    at = taken[-1].stamp_nanos // 2_500_000
    turned = headings(poses[: at + 1])
    x, y = (poses[at] - poses[0])[:2]
    return Driven(
        last=taken[-1],
        turned_rad=np.unwrap([yaw(reading) for reading in taken])[-1],
        true_m=(x, y),
        true_turned_rad=turned[-1] - turned[0],
        speed_mps=float(np.mean(speeds[len(speeds) // 2 :])),
        samples=felt[len(felt) // 2 :],
    )


@pytest.mark.parametrize(("speed", "seconds"), [(0.5, 8.0), (1.0, 5.0), (-0.4, 5.0)])
def test_on_a_straight_it_agrees_with_the_truth_within_its_own_covariance(
    speed: float, seconds: float
) -> None:
    driven = drive(speed, 0.0, seconds)
    x, y, _ = driven.last.position_m
    turned = driven.turned_rad - driven.true_turned_rad
    error = np.array([x - driven.true_m[0], y - driven.true_m[1], turned])
    known = covariance(driven.last.pose_covariance)[np.ix_(KNOWN, KNOWN)]
    assert abs(x) > 0.9 * abs(speed) * (seconds - 1)
    assert error @ np.linalg.inv(known) @ error < 7.8  # 95 % of chi-square with three degrees.
    assert np.hypot(*error[:2]) < 0.01 * abs(x)


def test_in_turns_wheels_skid_and_the_geometric_track_turns_too_far() -> None:
    geometric = drive(0.4, 0.5, 6.0, track_multiplier=1.0)
    assert geometric.turned_rad > 1.5 * geometric.true_turned_rad
    effective = drive(0.4, 0.5, 6.0)
    assert effective.turned_rad == pytest.approx(effective.true_turned_rad, rel=0.02)


def test_a_driven_circle_gives_speed_times_rate_in_lateral_acceleration() -> None:
    driven = drive(0.5, 0.5, 10.0)
    lateral = []
    for sample in driven.samples:
        turn = Rotation.from_quat(sample.orientation)
        # On its springs the rover leans outwards, by a milliradian; so gravity is taken out level.
        in_world = turn.apply(sample.linear_acceleration_mps2) - [0, 0, 9.80665]
        level = Rotation.from_euler("z", turn.as_euler("ZYX")[0])
        lateral.append(level.inv().apply(in_world)[1])
    rate = np.mean([sample.angular_velocity_radps[2] for sample in driven.samples])
    assert rate == pytest.approx(0.5, rel=0.05)
    assert np.mean(lateral) == pytest.approx(driven.speed_mps * rate, rel=0.01)


WORN = Encoders(
    name="wheels",
    topic="/wheels",
    frame="base_link",
    ticks_per_revolution=80914,
    scale_stddev=0.001,
    slip_stddev=0.01,
)
"""As the shipped scenarios have them."""


def test_its_covariance_is_the_spread_of_its_errors_within_a_factor_of_two() -> None:
    """Over drives, in each of which physics skids differently, and seeds, by which wheels err."""
    vehicle = replace(ROVER.vehicles[0], sensors=(WORN,))
    spec = WheelOdometry(name="odom", topic="/odom", frame="odom", encoders="wheels")
    ratios, errors = [], []
    for drive in ((0.8, 0.0), (0.8, 0.3), (0.4, 0.5), (0.3, 0.5), (-0.5, -0.2)):
        run = list(rolling(replace(ROVER, vehicles=(vehicle,)), *drive, 6.0))
        poses = [truth.poses()[0] for _, truth in run]
        turned = headings(poses)
        true = np.append((poses[-1] - poses[0])[:2], turned[-1] - turned[0])
        for seed in range(10):
            model = WheelOdometryModel(replace(ROVER, seed=seed), vehicle, spec)
            taken = readings(model, (state for state, _ in run))
            angle = np.unwrap([yaw(reading) for reading in taken])[-1]
            errors.append(np.array([*taken[-1].position_m[:2], angle]) - true)
            believed = np.diag(covariance(taken[-1].pose_covariance))[list(KNOWN)]
            ratios.append(errors[-1] ** 2 / believed)
    assert len({tuple(error) for error in errors}) == len(errors)
    spread = np.sqrt(np.mean(ratios, axis=0))
    assert (spread > 1 / 2).all(), spread
    assert (spread < 2).all(), spread


def test_without_errors_of_wheels_every_seed_counts_alike() -> None:
    way = np.linspace(0, 1, 401)
    first, second = (readings(odometry(seed=seed), rolled(way, way)) for seed in (1, 2))
    assert [encode(reading) for reading in first] == [encode(reading) for reading in second]
