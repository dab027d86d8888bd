# SPDX-License-Identifier: Apache-2.0
"""Errors against statistics: minutes of the data sheets, and what each parameter does."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from groundlink.messages.base import encode
from services.sensors.imu import errors
from services.sensors.imu.errors import ImuErrors
from services.sensors.imu.spec import GyroscopeNoise, InertialNoise, InertialUnit
from services.sensors.noise.random_streams import RandomStreams
from tests.services.sensors.allan import Floats, allan_deviation
from tests.services.sensors.imu.test_datasheets import SHEETS
from tests.services.sensors.imu.test_model import (
    GRAVITY,
    forces,
    imu,
    rates,
    samples,
    tumbling,
    turning,
)
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.states import states

BLOCKS = 3125
"""1000 s."""

ALL: dict[str, Any] = {
    "accelerometer": InertialNoise(
        noise_density=1.5e-3,
        bias_instability=4e-4,
        bias_time_constant_s=30,
        random_walk=1e-4,
        turn_on_bias=0.02,
        scale_factor=0.01,
        misalignment_deg=0.5,
        bias_per_k=1e-3,
        scale_per_k=1e-4,
        bandwidth_hz=98,
        saturation=20,
        resolution=0.005,
    ),
    "gyroscope": GyroscopeNoise(
        noise_density=2e-4,
        bias_instability=5e-5,
        random_walk=1e-5,
        turn_on_bias=0.003,
        scale_factor=0.01,
        misalignment_deg=0.5,
        g_sensitivity=1e-4,
        bias_per_k=1e-3,
        scale_per_k=1e-4,
        bandwidth_hz=44,
        saturation=4,
        resolution=0.001,
    ),
    "orientation_stddev_deg": 0.25,
}


def minutes(model: ImuErrors) -> Floats:
    return np.concatenate([model.added(block) for block in range(BLOCKS)])


@pytest.mark.parametrize("sheet", [s.stem for s in SHEETS if s.stem != "imu_ideal"])
def test_minutes_have_the_data_sheets_noise_density(sheet: str) -> None:
    spec = from_sheet(InertialUnit, sheet)
    taken = minutes(ImuErrors(spec, RandomStreams(1, "rover/imu")))
    for triad, axes in ((spec.accelerometer, taken[:, :3]), (spec.gyroscope, taken[:, 3:])):
        density = allan_deviation(axes, 400, 0.1) * np.sqrt(0.1)
        np.testing.assert_allclose(density, triad.noise_density, rtol=0.02)


def test_the_peak_of_a_gauss_markov_process_is_as_written() -> None:
    def negative(ratio: float) -> float:
        bracket = 1 - (3 - 4 * np.exp(-ratio) + np.exp(-2 * ratio)) / (2 * ratio)
        return -float(np.sqrt(2 / ratio * bracket))

    found = minimize_scalar(negative, bounds=(0.5, 5), method="bounded")
    assert found.x == pytest.approx(1.89, abs=0.01)
    assert -found.fun == pytest.approx(errors.PEAK_OF_GAUSS_MARKOV, abs=1e-5)


def test_minutes_show_each_term_with_its_slope() -> None:
    noise: dict[str, Any] = {
        "noise_density": 5e-4,
        "bias_instability": 2e-3,
        "bias_time_constant_s": 2.5,
        "random_walk": 3e-4,
    }
    spec = replace(
        from_sheet(InertialUnit, "imu_ideal"),
        accelerometer=InertialNoise(**noise),
        gyroscope=GyroscopeNoise(**noise),
        noise_source="numpy",
    )
    runs = [minutes(ImuErrors(spec, RandomStreams(seed, "rover/imu"))) for seed in range(2)]
    taken = np.concatenate(runs, axis=1)
    t = np.array([0.01, 0.02, 1.25, 4.725, 15, 75, 150])
    found = np.array([np.sqrt((allan_deviation(taken, 400, s) ** 2).mean()) for s in t])
    slopes = np.diff(np.log(found)) / np.diff(np.log(t))
    assert slopes[0] == pytest.approx(-0.5, abs=0.02)  # White noise.
    assert found[3] == pytest.approx(2e-3, rel=0.1)  # The bias that comes back: its peak,
    assert slopes[3] < 0  # and down from there,
    assert slopes[5] > 0.2  # until the walk takes over.
    ratio = t / 2.5
    bracket = 1 - (3 - 4 * np.exp(-ratio) + np.exp(-2 * ratio)) / (2 * ratio)
    wander = (2e-3 / errors.PEAK_OF_GAUSS_MARKOV) ** 2 * 2 / ratio * bracket
    expected = np.sqrt(2.5e-7 / t + wander + 9e-8 * t / 3)
    np.testing.assert_allclose(found[:5], expected[:5], rtol=0.08)
    np.testing.assert_allclose(found[5:], expected[5:], rtol=0.3)


def test_every_parameter_does_something_and_none_changes_a_byte_when_zero() -> None:
    _, _, run = tumbling(300)
    plain = [encode(s) for s in samples(imu(), run)]
    zeros: dict[str, Any] = {
        "accelerometer": InertialNoise(bias_time_constant_s=7),
        "gyroscope": GyroscopeNoise(bias_time_constant_s=7),
        "noise_source": "numpy",
    }
    assert [encode(s) for s in samples(imu(**zeros), run)] == plain
    for triad, kind in (("accelerometer", InertialNoise), ("gyroscope", GyroscopeNoise)):
        for field in kind.__struct_fields__:
            if field == "bias_time_constant_s":
                continue
            value = getattr(ALL[triad], field) if field != "saturation" else 0.5
            changed = samples(imu(air_c=35.0, **{triad: kind(**{field: value})}), run)
            assert [encode(s) for s in changed[-50:]] != plain[-50:], (triad, field)


def test_scale_and_misalignment_are_one_matrix_a_run() -> None:
    drawn = []
    for seed in range(120):
        spec: dict[str, Any] = {
            "accelerometer": InertialNoise(scale_factor=0.03, misalignment_deg=0.5),
        }
        columns = []
        for axis in np.eye(3):
            turn = Rotation.align_vectors([[0, 0, 1.0]], [axis])[0]
            taken = samples(imu(seed=seed, **spec), states(np.zeros((4, 3)), turn.as_quat()))
            felt = forces(taken) / GRAVITY
            np.testing.assert_allclose(felt[0], felt[1], atol=1e-12)
            columns.append(felt[0])
        drawn.append(np.array(columns).T - np.eye(3))
    matrices = np.array(drawn)
    sigma = np.full((3, 3), np.radians(0.5))
    np.fill_diagonal(sigma, 0.03)
    np.testing.assert_allclose(matrices.std(axis=0), sigma, rtol=5 / np.sqrt(240))


def test_gravity_leaks_into_the_gyroscope_by_its_sensitivity() -> None:
    found = []
    for seed in range(200):
        spec: dict[str, Any] = {"gyroscope": GyroscopeNoise(g_sensitivity=2e-4)}
        found.append(rates(samples(imu(seed=seed, **spec), states(np.zeros((3, 3)))))[0])
    assert np.std(found) == pytest.approx(2e-4 * GRAVITY, rel=5 / np.sqrt(1200))


def test_saturation_cuts_each_axis_on_both_sides() -> None:
    spec: dict[str, Any] = {
        "accelerometer": InertialNoise(saturation=9.0),
        "gyroscope": GyroscopeNoise(saturation=1.5),
    }
    for rate_radps, expected in ((1.0, 1.0), (2.0, 1.5), (-2.0, -1.5)):
        taken = samples(imu(**spec), turning(20, rate_radps=rate_radps))
        np.testing.assert_allclose(rates(taken)[:, 2], expected, rtol=1e-12)
        np.testing.assert_allclose(forces(taken)[:, 2], 9.0)


@pytest.mark.parametrize("rate_hz", [400, 100])
def test_readings_are_multiples_of_the_resolution(rate_hz: float) -> None:
    _, _, run = tumbling(200)
    spec: dict[str, Any] = {
        "accelerometer": InertialNoise(resolution=0.01),
        "gyroscope": GyroscopeNoise(resolution=0.002),
    }
    exact = samples(imu(rate_hz=rate_hz), run)
    taken = samples(imu(rate_hz=rate_hz, **spec), run)
    for felt, true, step in (
        (forces(taken), forces(exact), 0.01),
        (rates(taken), rates(exact), 0.002),
    ):
        np.testing.assert_allclose(felt / step, np.round(felt / step), atol=1e-6)
        assert np.abs(felt - true).max() <= step / 2 + 1e-12
    assert taken[0].linear_acceleration_variance == pytest.approx(0.01**2 / 12)


@pytest.mark.parametrize("rate_hz", [400, 100, 30, 29.97])
def test_the_variance_in_the_message_is_that_of_the_noise(rate_hz: float) -> None:
    spec: dict[str, Any] = {
        "accelerometer": InertialNoise(noise_density=1.5e-3, resolution=0.01),
        "gyroscope": GyroscopeNoise(noise_density=2e-4, bandwidth_hz=44),
        "noise_source": "numpy",
    }
    taken = samples(imu(rate_hz=rate_hz, **spec), states(np.zeros((20_000, 3))))
    count = 3 * len(taken)
    if rate_hz > 44:  # Neighbors are alike then.
        count = int(count * 88 / rate_hz)
    for felt, said in (
        (forces(taken), [s.linear_acceleration_variance for s in taken]),
        (rates(taken), [s.angular_velocity_variance for s in taken]),
    ):
        found = ((felt - felt.mean(axis=0)) ** 2).mean()
        assert found == pytest.approx(np.mean(said), rel=5 * np.sqrt(2 / count))


def test_behind_a_low_pass_the_noise_is_that_of_its_bandwidth() -> None:
    """A Butterworth of second order passes as much noise as a wall at 1.11 times its bandwidth."""
    spec = from_sheet(InertialUnit, "imu_mpu6000")
    taken = samples(
        imu(rate_hz=400, gyroscope=spec.gyroscope, noise_source="numpy"),
        states(np.zeros((20_000, 3))),
    )
    spread = (rates(taken) - rates(taken).mean(axis=0)).std()
    expected = spec.gyroscope.noise_density * np.sqrt(2 * 1.11 * spec.gyroscope.bandwidth_hz)
    assert spread == pytest.approx(expected, rel=0.03)


def test_a_circle_at_constant_speed_gives_speed_times_rate() -> None:
    speed, radius = 1.2, 3.0
    angle = speed / radius * np.arange(800) / 400
    places = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    heading = Rotation.from_euler("z", (angle + np.pi / 2)[:, None]).as_quat()
    taken = samples(imu(rate_hz=100), states(places, heading))
    lateral, turn = forces(taken)[:, 1], rates(taken)[:, 2]
    np.testing.assert_allclose(lateral, speed * turn, rtol=0.01)
    np.testing.assert_allclose(turn, speed / radius, rtol=1e-9)
    assert np.abs(forces(taken)[:, 0]).max() < 0.01 * speed * speed / radius


def test_another_source_of_numbers_and_another_seed_give_other_bytes() -> None:
    run = list(states(np.zeros((60, 3))))
    taken = [
        [encode(s) for s in samples(imu(**fields, **ALL), run)]
        for fields in ({}, {"noise_source": "numpy"}, {"seed": 2}, {"name": "second_imu"})
    ]
    assert taken[0] == [encode(s) for s in samples(imu(**ALL), run)]
    for i, one in enumerate(taken):
        for other in taken[:i]:
            assert not set(one) & set(other)


WARM = InertialUnit(
    name="imu",
    topic="/imu",
    frame="imu",
    accelerometer=InertialNoise(bias_per_k=2e-3, scale_per_k=1e-3, misalignment_deg=0.5),
    gyroscope=GyroscopeNoise(bias_per_k=1e-3, scale_per_k=5e-4),
    self_heating_k=10.0,
    warm_up_s=100.0,
)


def thermal(air_c: float, tick: int) -> Floats:
    """Return what a force and a rate of 1 along all axes reads, without that at no temperature."""
    one, streams = (1.0, 1.0, 1.0), RandomStreams(1, "rover/imu")
    at = ImuErrors(WARM, streams, air_c).measured(one, one, tick)
    return np.subtract(at, ImuErrors(WARM, streams).measured(one, one, tick))


def test_a_sensor_warms_up_by_its_time_constant() -> None:
    unit = ImuErrors(WARM, RandomStreams(1, "rover/imu"), -5.0)
    assert unit.temperature_c(0, -5.0) == -5.0
    assert unit.temperature_c(100 * 400, -5.0) == pytest.approx(-5.0 + 10.0 * (1 - np.exp(-1)))
    assert unit.temperature_c(2000 * 400, -5.0) == pytest.approx(5.0)


def test_biases_and_scales_are_linear_in_temperature() -> None:
    assert np.all(thermal(25.0, 0) == 0.0)
    cold, hot = thermal(-15.0, 0), thermal(65.0, 0)
    np.testing.assert_allclose(cold, -hot, rtol=1e-9)
    assert np.all(np.abs(hot) > 1e-6)
    # Warmed up by 10 K, in the same air.
    late = 2000 * 400 // 128 * 128
    np.testing.assert_allclose(thermal(25.0, late), hot / 4, rtol=1e-6)


def test_thermal_biases_have_the_sigma_of_the_sheet() -> None:
    unit = replace(WARM, accelerometer=replace(WARM.accelerometer, scale_per_k=0.0))
    still = (0.0, 0.0, 0.0)
    biases = [
        ImuErrors(unit, RandomStreams(seed, "rover/imu"), 35.0).measured(still, still, 0)[:3]
        for seed in range(200)
    ]
    assert np.std(biases) == pytest.approx(10 * 2e-3, rel=0.1)


def test_a_successor_is_as_warm() -> None:
    streams, one = RandomStreams(1, "rover/imu"), (1.0, 1.0, 1.0)
    before = ImuErrors(WARM, streams, 40.0)
    for tick in range(1000, 1100):
        last = before.measured(one, one, tick)
    assert ImuErrors(WARM, streams, 40.0).measured(one, one, 1099) == last
