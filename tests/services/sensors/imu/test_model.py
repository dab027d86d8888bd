# SPDX-License-Identifier: Apache-2.0
from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from groundlink.messages import base as messages
from groundlink.messages.base import BadBusMessage, State
from groundlink.scenario.every_sensor import Mount
from groundlink.world.weather import Weather
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import GyroscopeNoise, InertialNoise, InertialUnit
from services.sensors.runtime.model import SensorModel
from tests.services.sensors.states import EPOCH_NANOS, scenario, states

DT = 1 / 400
GRAVITY = 9.80665


def imu(
    *,
    seed: int = 1,
    name: str = "imu",
    frame_prefix: str = "",
    air_c: float | None = None,
    **fields: Any,
) -> ImuModel:
    run = scenario(seed=seed, frame_prefix=frame_prefix)
    run = replace(run, world=replace(run.world, weather=Weather(temperature_c=air_c)))
    spec = InertialUnit(name=name, topic="/imu", frame="imu_link", **fields)
    return ImuModel(run, run.vehicles[0], spec)


def samples(model: SensorModel, run: Iterable[State]) -> list[messages.Imu]:
    taken: list[messages.Imu] = []
    for state in run:
        for reading in model.readings(state):
            assert isinstance(reading, messages.Imu)
            taken.append(reading)
    return taken


def forces(taken: Iterable[messages.Imu]) -> NDArray[np.float64]:
    return np.array([sample.linear_acceleration_mps2 for sample in taken])


def rates(taken: Iterable[messages.Imu]) -> NDArray[np.float64]:
    return np.array([sample.angular_velocity_radps for sample in taken])


def orientations(taken: Iterable[messages.Imu]) -> Rotation:
    return Rotation.from_quat([sample.orientation for sample in taken])


def tumbling(ticks: int, seed: int = 0) -> tuple[NDArray[np.float64], Rotation, list[State]]:
    """Return velocities, orientations and states of a body under random forces and torques.

    Integrated as the physics engine does: first the velocities, then the pose by the new ones.
    """
    random = np.random.default_rng(seed)
    velocity, position, turn = random.normal(size=3), random.normal(size=3), Rotation.random(rng=1)
    velocities, positions, turns = [], [], []
    for _ in range(ticks):
        velocity = velocity + random.normal(size=3) * 20 * DT
        position = position + velocity * DT
        turn = Rotation.from_rotvec(random.normal(size=3) * 2 * DT) * turn
        velocities.append(velocity)
        positions.append(position)
        turns.append(turn)
    turned = Rotation.concatenate(turns)
    return np.array(velocities), turned, list(states(positions, turned.as_quat()))


def turning(ticks: int, *, rate_radps: float, growth_radps2: float = 0.0) -> list[State]:
    """Return states of a body that stands and turns about the world's z."""
    time = np.arange(ticks) * DT
    angle = rate_radps * time + growth_radps2 * time**2 / 2
    return list(states(np.zeros((ticks, 3)), Rotation.from_euler("z", angle[:, None]).as_quat()))


# What it reads without errors


def test_level_and_at_rest_it_reads_gravity_and_nothing_else() -> None:
    taken = samples(imu(), states(np.full((10, 3), 0.7)))
    assert len(taken) == 8
    for sample in taken:
        assert sample.linear_acceleration_mps2 == (0.0, 0.0, GRAVITY)
        assert sample.angular_velocity_radps == (0.0, 0.0, 0.0)
        assert sample.orientation == (0.0, 0.0, 0.0, 1.0)
        assert sample.linear_acceleration_variance == 0
        assert sample.angular_velocity_variance == 0
        assert sample.orientation_variance == 0


@pytest.mark.parametrize("rate_hz", [400, 100, 30, 29.97])
def test_at_rest_every_rate_reads_the_same(rate_hz: float) -> None:
    taken = samples(imu(rate_hz=rate_hz), states(np.full((200, 3), 0.7)))
    np.testing.assert_allclose(forces(taken), [[0, 0, GRAVITY]] * len(taken), rtol=0, atol=1e-14)
    assert not rates(taken).any()


def test_in_free_fall_it_reads_nothing() -> None:
    ticks = np.arange(100)
    heights = -GRAVITY * DT**2 * ticks * (ticks + 1) / 2  # The engine's steps, summed.
    taken = samples(imu(), states(np.stack([0 * ticks, 0 * ticks, heights], axis=1)))
    np.testing.assert_allclose(forces(taken), np.zeros((98, 3)), atol=1e-9)


@pytest.mark.parametrize("rpy_deg", [(30, 0, 0), (0, -20, 0), (10, 25, 140), (180, 0, 0)])
def test_tilted_at_rest_gravity_turns_into_the_sensors_frame(rpy_deg: list[float]) -> None:
    tilt = Rotation.from_euler("xyz", rpy_deg, degrees=True)
    taken = samples(imu(), states(np.zeros((5, 3)), tilt.as_quat()))
    expected = tilt.inv().apply([0, 0, GRAVITY])
    np.testing.assert_allclose(forces(taken), [expected] * 3, atol=1e-14)
    np.testing.assert_allclose(rates(taken), np.zeros((3, 3)), atol=1e-13)
    np.testing.assert_allclose(orientations(taken).as_quat(), [tilt.as_quat()] * 3, atol=1e-15)


def test_a_turned_mount_turns_readings_and_orientation() -> None:
    mount = Mount(xyz_m=(0.3, -0.2, 0.1), rpy_deg=(15, -35, 80))
    base_from_sensor = Rotation.from_euler("xyz", mount.rpy_deg, degrees=True)
    _, turned, run = tumbling(50)
    straight = samples(imu(mount=Mount(xyz_m=mount.xyz_m)), run)
    rotated = samples(imu(mount=mount), run)
    inverse = base_from_sensor.inv()
    np.testing.assert_allclose(forces(rotated), inverse.apply(forces(straight)), atol=1e-9)
    np.testing.assert_allclose(rates(rotated), inverse.apply(rates(straight)), atol=1e-11)
    error = (turned[2:] * base_from_sensor).inv() * orientations(rotated)
    assert error.magnitude().max() < 1e-14


@pytest.mark.parametrize("rate_hz", [400, 100, 30])
@pytest.mark.parametrize("mount_xyz_m", [(0.5, 0, 0), (0.3, -0.4, 0.2)])
def test_off_center_in_a_steady_turn_it_reads_the_centripetal_acceleration(
    rate_hz: float, mount_xyz_m: tuple[float, float, float]
) -> None:
    omega = 2.0
    model = imu(rate_hz=rate_hz, mount=Mount(xyz_m=mount_xyz_m))
    taken = samples(model, turning(200, rate_radps=omega))
    x, y, _ = mount_xyz_m
    expected = [-(omega**2) * x, -(omega**2) * y, GRAVITY]
    # Three points of a circle have the chord's curvature: less by (omega dt)^2 / 12, 2e-6 here.
    np.testing.assert_allclose(forces(taken), [expected] * len(taken), rtol=3e-6, atol=1e-9)
    np.testing.assert_allclose(rates(taken), [[0, 0, omega]] * len(taken), atol=1e-11)


def test_off_center_in_a_growing_turn_it_reads_the_euler_term() -> None:
    alpha, radius = 3.0, 0.5
    taken = samples(
        imu(mount=Mount(xyz_m=(radius, 0, 0))),
        turning(200, rate_radps=1.0, growth_radps2=alpha),
    )
    # Force and rate are both centered one tick before the stamp.
    omega = 1.0 + alpha * DT * np.arange(1, 199)
    expected = np.stack(
        [-(omega**2) * radius, np.full(198, alpha * radius), np.full(198, GRAVITY)], axis=1
    )
    np.testing.assert_allclose(forces(taken), expected, rtol=2e-5)
    np.testing.assert_allclose(rates(taken)[:, 2], omega, rtol=1e-10)


def test_its_readings_add_up_to_the_bodys_motion() -> None:
    velocities, turned, run = tumbling(400)
    taken = samples(imu(), run)
    assert len(taken) == 398
    half_ticks = [
        a * Rotation.from_rotvec((a.inv() * b).as_rotvec() / 2) for a, b in pairwise(turned)
    ]
    velocity, turn = velocities[1], half_ticks[0]
    for k, sample in enumerate(taken, start=2):
        force = turned[k - 1].apply(sample.linear_acceleration_mps2)
        velocity = velocity + DT * (force - [0, 0, GRAVITY])
        turn = turn * Rotation.from_rotvec(np.multiply(sample.angular_velocity_radps, DT))
        np.testing.assert_allclose(velocity, velocities[k], atol=1e-11)
        assert (turn.inv() * half_ticks[k - 1]).magnitude() < 1e-12
        np.testing.assert_allclose(abs(sample.orientation @ turned[k].as_quat()), 1, atol=1e-15)


@pytest.mark.parametrize("rate_hz", [400, 200, 100, 30])
def test_force_and_rate_are_centered_at_the_same_instant(rate_hz: float) -> None:
    """On an analytic motion both lag by half an interval and half a tick, and by nothing else."""
    omega, heave_m, swing_rad = 2 * np.pi * 1.5, 0.05, 0.4
    time = np.arange(4 * 400 + 1) * DT
    heave = np.stack([0 * time, 0 * time, heave_m * np.sin(omega * time)], axis=1)
    swing = Rotation.from_euler("z", swing_rad * np.sin(omega * time[:, None])).as_quat()
    taken = samples(imu(rate_hz=rate_hz), states(heave, swing))
    stamps = np.array([sample.stamp_nanos - EPOCH_NANOS for sample in taken]) * 1e-9
    waves = np.stack([np.sin(omega * stamps), np.cos(omega * stamps)], axis=1)

    def lag(readings: NDArray[np.float64], sine: float, cosine: float) -> float:
        """Return by how much readings are late against sine and cosine of these amplitudes."""
        (s, c), *_ = np.linalg.lstsq(waves, readings)
        return float(np.arctan2(cosine, sine) - np.arctan2(c, s)) % (2 * np.pi) / omega

    of_force = lag(forces(taken)[:, 2] - GRAVITY, -heave_m * omega**2, 0.0)
    of_rate = lag(rates(taken)[:, 2], 0.0, swing_rad * omega)
    assert of_force == pytest.approx(of_rate, abs=1e-6)
    assert of_rate == pytest.approx(1 / rate_hz / 2 + DT / 2, abs=2e-5)


# Rates below the engine's


def shaken(ticks: int) -> tuple[NDArray[np.float64], list[State]]:
    """Return velocities and states of a body shaken hard along all axes, without turning."""
    velocities = np.random.default_rng(5).normal(size=(ticks, 3))
    return velocities, list(states(np.cumsum(velocities * DT, axis=0)))


def test_at_100_hz_a_sample_is_the_mean_of_four_ticks() -> None:
    _, run = shaken(100)
    every, fourth = samples(imu(), run), samples(imu(rate_hz=100), run)
    # The first window that begins after two states runs from tick 4 to tick 8.
    assert fourth[0].stamp_nanos - EPOCH_NANOS == 20_000_000
    means = forces(every)[3:95].reshape(-1, 4, 3).mean(axis=1)
    np.testing.assert_allclose(forces(fourth), means, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("rate_hz", [400, 250, 100, 30, 29.97, 7])
def test_readings_times_intervals_are_the_change_of_velocity(rate_hz: float) -> None:
    velocities, run = shaken(500)
    taken = samples(imu(rate_hz=rate_hz), run)
    stamps = np.array([sample.stamp_nanos - EPOCH_NANOS for sample in taken])
    intervals = np.diff(stamps) * 1e-9
    gained = np.cumsum((forces(taken)[1:] - [0, 0, GRAVITY]) * intervals[:, None], axis=0)
    # Between two ticks the engine's velocity changes at a constant rate.
    times = stamps / 2_500_000
    at_stamps = np.stack([np.interp(times, np.arange(500), v) for v in velocities.T], axis=1)
    np.testing.assert_allclose(gained, at_stamps[1:] - at_stamps[0], atol=1e-9)


def test_at_a_low_rate_a_turn_within_the_window_is_not_wrapped() -> None:
    taken = samples(imu(rate_hz=1), turning(1300, rate_radps=5.0))
    assert len(taken) == 2
    np.testing.assert_allclose(rates(taken), [[0, 0, 5.0]] * 2, rtol=1e-12)


def test_between_two_ticks_the_orientation_is_that_of_the_stamp() -> None:
    taken = samples(imu(rate_hz=30), turning(200, rate_radps=2.0))
    angles = [2.0 * (sample.stamp_nanos - EPOCH_NANOS) * 1e-9 for sample in taken]
    expected = Rotation.from_euler("z", np.array(angles)[:, None])
    assert (expected.inv() * orientations(taken)).magnitude().max() < 1e-12


@pytest.mark.parametrize("rate_hz", [400, 100, 60, 30, 29.97, 0.7])
def test_stamps_are_the_schedules_and_readings_come_as_soon_as_they_can(rate_hz: float) -> None:
    model = imu(rate_hz=rate_hz)
    index = None
    for state in states(np.zeros((1500, 3))):
        for sample in model.readings(state):
            if index is None:
                index = round(
                    Fraction(sample.stamp_nanos - EPOCH_NANOS, 10**9) * Fraction(str(rate_hz))
                )
            nanos = index * 10**9 / Fraction(str(rate_hz))
            assert sample.stamp_nanos - EPOCH_NANOS == int(nanos)
            assert state.tick - 1 < nanos / 2_500_000 <= state.tick
            index += 1
    # Nothing is left out: the next is not due before the last state.
    assert index is not None
    assert index * 400 / Fraction(str(rate_hz)) > 1499


def test_the_first_sample_needs_three_states() -> None:
    run = list(states(np.zeros((10, 3)), first_tick=77))
    model = imu()
    assert [len(model.readings(state)) for state in run[:4]] == [0, 0, 1, 1]
    model.restart()
    assert model.settled_tick() == -1
    assert [len(model.readings(state)) for state in run[4:8]] == [0, 0, 1, 1]


def test_a_state_without_the_vehicle_is_refused() -> None:
    (state,) = states(np.zeros((1, 3)))
    empty = replace(state.vehicles["rover"], link_poses=memoryview(b""))
    for vehicles in ({}, {"rover": empty}):
        with pytest.raises(BadBusMessage, match="state of tick 0: no link poses of `rover`"):
            imu().readings(replace(state, vehicles=vehicles))


# Errors


def test_white_noise_has_the_sigma_of_its_density_and_rate() -> None:
    rate_hz, count = 100.0, 5000
    spec: dict[str, Any] = {
        "accelerometer": InertialNoise(noise_density=1.5e-3),
        "gyroscope": GyroscopeNoise(noise_density=2e-4),
        "orientation_stddev_deg": 0.25,
    }
    taken = samples(imu(rate_hz=rate_hz, **spec), states(np.zeros((4 * (count + 1), 3))))
    assert len(taken) >= count - 1
    errors = {
        "linear_acceleration": (forces(taken) - [0, 0, GRAVITY], 1.5e-3 * 10),
        "angular_velocity": (rates(taken), 2e-4 * 10),
        "orientation": (orientations(taken).as_rotvec(), np.radians(0.25)),
    }
    for quantity, (error, sigma) in errors.items():
        # Relative standard error of a standard deviation is 1 / sqrt(2 n), of a mean 1 / sqrt(n).
        np.testing.assert_allclose(error.std(axis=0), sigma, rtol=5 / np.sqrt(2 * count))
        assert np.abs(error.mean(axis=0)).max() < 5 * sigma / np.sqrt(count)
        variance = getattr(taken[0], f"{quantity}_variance")
        assert variance == pytest.approx(sigma**2, rel=1e-12)
    whitened = np.concatenate([error / sigma for error, sigma in errors.values()], axis=1)
    correlations = np.corrcoef(np.concatenate([whitened[1:], whitened[:-1]], axis=1).T)
    assert np.abs(correlations - np.eye(18)).max() < 5 / np.sqrt(count)


def test_the_turn_on_bias_is_one_draw_a_run() -> None:
    spec: dict[str, Any] = {
        "accelerometer": InertialNoise(turn_on_bias=0.2),
        "gyroscope": GyroscopeNoise(turn_on_bias=0.01),
    }
    biases = []
    for seed in range(300):
        taken = samples(imu(seed=seed, **spec), states(np.zeros((4, 3))))
        felt = np.concatenate([forces(taken) - [0, 0, GRAVITY], rates(taken)], axis=1)
        np.testing.assert_allclose(felt[0], felt[1], atol=1e-15)
        biases.append(felt[0] / np.repeat([0.2, 0.01], 3))
    drawn = np.array(biases)
    np.testing.assert_allclose(drawn.std(axis=0), 1, rtol=5 / np.sqrt(600))
    np.testing.assert_allclose(drawn.mean(axis=0), 0, atol=5 / np.sqrt(300))


def test_a_bias_changes_only_what_it_belongs_to() -> None:
    spec: dict[str, Any] = {"gyroscope": GyroscopeNoise(turn_on_bias=0.01)}
    taken = samples(imu(**spec), states(np.zeros((4, 3))))
    assert forces(taken).tolist() == [[0.0, 0.0, GRAVITY]] * 2
    assert rates(taken).all()
    assert taken[0].orientation == (0.0, 0.0, 0.0, 1.0)
