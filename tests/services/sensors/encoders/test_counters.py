# SPDX-License-Identifier: Apache-2.0
"""What counters do beyond counting: gears, signs, wraps, missed ticks, resets, and their memory."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from groundlink.messages import base as messages
from groundlink.messages.base import State, encode
from services.sensors.encoders.model import EncodersModel
from services.sensors.encoders.spec import Encoders
from services.sensors.runtime.wheel_counters import wrapped
from tests.services.sensors.encoders.test_model import RESOLUTION, counts, readings, turned
from tests.services.sensors.states import WHEELS, scenario

TURN = 2 * np.pi


def encoders(*, seed: int = 1, name: str = "wheels", **fields: Any) -> EncodersModel:
    run = scenario(seed=seed)
    given = {"rate_hz": 400} | fields
    spec = Encoders(name=name, topic="/wheels", frame="base_link", **given)
    return EncodersModel(run, run.vehicles[0], spec)


def differences(ticks: NDArray[np.int64]) -> list[int]:
    return [wrapped(int(now) - int(then)) for then, now in pairwise(ticks[:, 0])]


@pytest.mark.parametrize(
    ("fields", "a_turn"),
    [
        ({"ticks_per_revolution": 500}, 500),
        ({"ticks_per_revolution": 500, "quadrature": 4}, 2000),
        ({"ticks_per_revolution": 500, "quadrature": 4, "gear_ratio": 25.5}, 51_000),
        ({"ticks_per_revolution": 6, "pole_pairs": 15}, 90),
        ({"ticks_per_revolution": 6, "pole_pairs": 7, "gear_ratio": 14}, 588),
    ],
)
def test_a_turn_of_the_wheel_counts_periods_edges_poles_and_gears(
    fields: dict[str, Any], a_turn: int
) -> None:
    taken = counts(readings(encoders(**fields), turned([0.0, TURN, -3 * TURN])))
    assert taken[:, 0].tolist() == [0, a_turn, -3 * a_turn]


def test_a_reversed_wheel_counts_down_when_it_rolls_forward() -> None:
    model = encoders(reversed_wheels=(WHEELS[1],))
    taken = counts(readings(model, turned([0.0, 10.2 * RESOLUTION, -4.2 * RESOLUTION])))
    assert taken.tolist() == [[0, 0], [10, -10], [-4, 4]]


@pytest.mark.parametrize("start", [2**62 - 5, -(2**62) + 5, 2**53, 0])
def test_nothing_is_lost_beyond_2_to_62(start: int) -> None:
    angles = np.cumsum(np.random.default_rng(4).normal(scale=3 * RESOLUTION, size=500))
    far = counts(readings(encoders(start_ticks=start), turned(angles)))
    near = counts(readings(encoders(), turned(angles)))
    assert (far - start).tolist() == near.tolist()
    if start == 2**62 - 5:
        assert far.min() < 2**62 < far.max()


@pytest.mark.parametrize("direction", [1, -1])
def test_at_2_to_63_counters_wrap_as_64_bits_do(direction: int) -> None:
    start = 2**63 - 5 if direction > 0 else -(2**63) + 4
    angles = direction * np.arange(20) * RESOLUTION
    run = turned(angles)
    model = encoders(start_ticks=start)
    taken = [r for state in run for r in model.readings(state)]
    assert [messages.decode(encode(r), messages.WheelEncoders) for r in taken] == taken
    assert differences(counts(taken)) == [direction] * 19
    assert (counts(taken)[-1, 0] < 0) == (direction > 0)


@pytest.mark.parametrize(
    ("count", "held"),
    [(0, 0), (2**63 - 1, 2**63 - 1), (2**63, -(2**63)), (-(2**63) - 1, 2**63 - 1), (2**64 + 7, 7)],
)
def test_wrapped(count: int, held: int) -> None:
    assert wrapped(count) == held


# Missed ticks


@pytest.mark.parametrize("probability", [0.001, 0.1, 1.0])
@pytest.mark.parametrize("direction", [1, -1])
def test_the_share_of_missed_ticks_is_that_of_the_scenario(
    probability: float, direction: int
) -> None:
    angles = direction * np.arange(4001) * 10 * RESOLUTION
    ticks = counts(readings(encoders(missed_ticks=probability), turned(angles)))
    expected = 40_000 * (1 - probability)
    spread = np.sqrt(40_000 * probability * (1 - probability))
    np.testing.assert_allclose(ticks[-1] * direction, expected, atol=5 * spread)
    assert (np.diff(ticks[:, 0]) * direction >= 0).all()
    assert probability == 1.0 or ticks[-1, 0] != ticks[-1, 1]  # Each wheel misses its own.


def test_a_wheel_at_rest_misses_nothing() -> None:
    assert not counts(readings(encoders(missed_ticks=0.5), turned(np.zeros(50)))).any()


@pytest.mark.parametrize("rate_hz", [30, 29.97])
def test_between_two_ticks_as_much_is_missed_as_of_the_way(rate_hz: float) -> None:
    run = turned(np.arange(400) * 1000 * RESOLUTION)
    ticks = counts(readings(encoders(missed_ticks=0.5, rate_hz=rate_hz), run))[:, 0]
    sent = [r.stamp_nanos for r in readings(encoders(rate_hz=rate_hz), run)]
    way = (np.array(sent) - sent[0]) / 2_500_000 * 1000
    np.testing.assert_allclose(ticks, way / 2, atol=5 * np.sqrt(400_000 / 4))
    assert (np.diff(ticks) > 0).all()
    none = counts(readings(encoders(missed_ticks=1.0, rate_hz=rate_hz), run))
    assert np.abs(none).max() <= 1  # Each of the two shares is rounded by itself.


# Resets


def test_counters_restart_after_a_reset() -> None:
    model = encoders(resets_s=(0.01, 0.0301))
    ticks = counts(readings(model, turned(np.arange(20) * 10 * RESOLUTION)))[:, 0]
    # A reading of the very instant is that of before; 30.1 ms are in effect from tick 13 on.
    expected = [0, 10, 20, 30, 40, *range(10, 100, 10), *range(10, 70, 10)]
    assert ticks.tolist() == expected


def test_resets_out_of_order_are_refused() -> None:
    with pytest.raises(msgspec.ValidationError, match="`resets_s` is out of order"):
        msgspec.convert(
            {"name": "w", "topic": "/w", "frame": "base_link", "resets_s": [2.0, 1.0]},
            Encoders,
        )


# Memory

FAULTY: dict[str, Any] = {
    "missed_ticks": 0.05,
    "resets_s": (0.1, 0.25, 0.5),
    "reversed_wheels": (WHEELS[1],),
    "start_ticks": 2**62 - 100,
}


def moving(ticks: int = 400) -> list[State]:
    angles = np.cumsum(np.random.default_rng(6).normal(scale=0.1, size=ticks))
    return turned(angles, 2 * angles)


def bytes_of(taken: Sequence[messages.WheelEncoders]) -> dict[int, bytes]:
    return {reading.stamp_nanos: encode(reading) for reading in taken}


def test_empty_memory_starts_over() -> None:
    run = moving()
    whole = bytes_of(readings(encoders(**FAULTY), run))
    model = encoders(**FAULTY)
    readings(model, run)
    model.restart()
    model.remember(b"")
    assert bytes_of(readings(model, run)) == whole
