# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from services.sensors.noise.error_processes import BLOCK_TICKS, BLOCKS_PER_DRAW, ErrorProcesses
from services.sensors.noise.random_streams import RandomStreams
from tests.services.sensors.allan import Floats, allan_deviation

TICK_S = 0.0025
COLUMNS = 24


def walks(
    stddev: float = 1.0, time_constant_s: float = math.inf, *, source: str = "numpy", seed: int = 1
) -> ErrorProcesses:
    return ErrorProcesses(
        RandomStreams(seed, "rover/imu"),
        "bias",
        stddevs=[stddev] * COLUMNS,
        time_constants_s=[time_constant_s] * COLUMNS,
        noise_source=source,
    )


def path(model: ErrorProcesses, seconds: float) -> Floats:
    blocks = math.ceil(seconds / TICK_S / BLOCK_TICKS)
    return np.concatenate([model.block(i) for i in range(blocks)])


def test_a_gauss_markov_process_has_its_sigma_and_its_correlation() -> None:
    time_constant = 0.2  # Shorter than a block of 0.32 s, so that blocks' ends and insides count.
    taken = path(walks(3.0, time_constant), 240)
    independent = 240 / (2 * time_constant) * COLUMNS
    assert taken.std() == pytest.approx(3, rel=5 / math.sqrt(2 * independent))
    for lag in (1, 20, 100, 160):
        correlation = (taken[lag:] * taken[:-lag]).mean() / 9
        expected = math.exp(-lag * TICK_S / time_constant)
        assert correlation == pytest.approx(expected, abs=5 / math.sqrt(independent))


@pytest.mark.parametrize("time_constant_s", [0.5, math.inf])
def test_every_step_is_alike_whether_it_crosses_into_another_block_or_not(
    time_constant_s: float,
) -> None:
    taken = path(walks(1.0, time_constant_s), 320)
    left = math.exp(-TICK_S / time_constant_s)
    surprises = (taken[1:] - left * taken[:-1])[: 999 * BLOCK_TICKS].reshape(999, BLOCK_TICKS, -1)
    expected = math.sqrt(TICK_S if math.isinf(time_constant_s) else 1 - left**2)
    by_place = surprises.std(axis=(0, 2))  # The last place is the step into the next block.
    np.testing.assert_allclose(by_place, expected, rtol=5 / math.sqrt(2 * 999 * COLUMNS))
    flat = surprises.reshape(-1, COLUMNS) / expected
    for lag in (1, 2, BLOCK_TICKS - 1, BLOCK_TICKS):
        assert abs((flat[lag:] * flat[:-lag]).mean()) < 5 / math.sqrt(flat.size)


def test_a_random_walk_begins_at_zero_and_grows_with_the_root_of_time() -> None:
    taken = path(walks(2.0), 100)
    assert not taken[0].any()
    ends = np.concatenate([walks(2.0, seed=s).block(312)[0] for s in range(40)])
    expected = 2 * math.sqrt(312 * 0.32)
    assert ends.std() == pytest.approx(expected, rel=5 / math.sqrt(2 * len(ends)))


def test_a_gauss_markov_process_has_its_sigma_from_the_first_tick_on() -> None:
    first = np.concatenate([walks(2.0, 500.0, seed=s).block(0)[0] for s in range(40)])
    assert first.std() == pytest.approx(2, rel=5 / math.sqrt(2 * 40 * COLUMNS))


def test_ten_minutes_of_a_random_walk_have_the_allan_deviation_of_its_density() -> None:
    seconds = 600
    taken = path(walks(0.02), seconds)
    for interval in (0.1, 1.0, 10.0):
        independent = seconds / interval * COLUMNS
        assert allan_deviation(taken, 400, interval).mean() == pytest.approx(
            0.02 * math.sqrt(interval / 3), rel=3 / math.sqrt(2 * independent)
        )


def test_a_gauss_markov_process_rises_and_falls_as_it_should() -> None:
    time_constant = 2.5
    taken = path(walks(1.0, time_constant), 360 * time_constant)
    ratio = np.array([0.02, 0.04, 1.89, 20.0, 40.0])
    intervals = ratio * time_constant
    found = np.array([allan_deviation(taken, 400, t).mean() for t in intervals])
    bracket = 1 - (3 - 4 * np.exp(-ratio) + np.exp(-2 * ratio)) / (2 * ratio)
    np.testing.assert_allclose(found, np.sqrt(2 / ratio * bracket), rtol=0.05)
    slopes = np.diff(np.log(found)) / np.diff(np.log(intervals))
    assert slopes[0] == pytest.approx(0.5, abs=0.015)
    assert slopes[3] == pytest.approx(-0.5, abs=0.1)


@pytest.mark.parametrize("source", ["marsaglia", "numpy"])
def test_block_does_not_depend_on_earlier_blocks(source: str) -> None:
    late = BLOCKS_PER_DRAW + 3
    model = walks(1.0, 30.0, source=source)
    whole = {index: model.block(index).tobytes() for index in range(late + 1)}
    for index in (late, 0, late, 5, BLOCKS_PER_DRAW - 1, BLOCKS_PER_DRAW):
        assert model.block(index).tobytes() == whole[index]
        assert walks(1.0, 30.0, source=source).block(index).tobytes() == whole[index]
    assert walks(1.0, 30.0, source=source, seed=2).block(5).tobytes() != whole[5]


def test_no_output_without_request() -> None:
    assert not path(walks(0.0), 1).any()
    assert not path(walks(0.0, 10.0), 1).any()
