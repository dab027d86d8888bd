# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.messages import base as messages
from groundlink.messages.base import BadBusMessage, State, encode
from groundlink.scenario.vehicle import VehicleModel
from services.sensors.encoders.model import EncodersModel
from services.sensors.encoders.spec import Encoders
from services.sensors.runtime.model import SensorModel
from tests.services.sensors.states import EPOCH_NANOS, WHEELS, scenario, states

TICKS_PER_REVOLUTION = 4096
RESOLUTION = 2 * math.pi / TICKS_PER_REVOLUTION


def encoders(*, frame_prefix: str = "", rate_hz: float = 400) -> EncodersModel:
    run = scenario(frame_prefix=frame_prefix)
    spec = Encoders(
        name="wheels",
        topic="/wheels",
        frame="base_link",
        rate_hz=rate_hz,
        ticks_per_revolution=TICKS_PER_REVOLUTION,
    )
    return EncodersModel(run, run.vehicles[0], spec)


def turned(left: ArrayLike, right: ArrayLike | None = None, **fields: Any) -> list[State]:
    """Return states with the wheels at the given angles in radians, one a tick."""
    lefts = np.asarray(left, np.float64)
    joints = np.stack([lefts, lefts if right is None else np.asarray(right)], axis=1)
    return list(states(np.zeros((len(lefts), 3)), joint_positions=joints, **fields))


def readings(model: SensorModel, run: Iterable[State]) -> list[messages.WheelEncoders]:
    taken: list[messages.WheelEncoders] = []
    for state in run:
        for reading in model.readings(state):
            assert isinstance(reading, messages.WheelEncoders)
            taken.append(reading)
        assert model.settled_tick() == state.tick
    return taken


def counts(taken: Iterable[messages.WheelEncoders]) -> NDArray[np.int64]:
    return np.array([reading.ticks for reading in taken], np.int64)


@pytest.mark.parametrize("turns", [1, -1, 3, -250, 100_000])
def test_full_turn_has_the_declared_number_of_ticks(turns: int) -> None:
    taken = readings(encoders(), turned([0.0, turns * 2 * math.pi]))
    assert counts(taken).tolist() == [[0, 0], [turns * TICKS_PER_REVOLUTION] * 2]


def test_each_wheel_has_its_own_counter_by_its_name() -> None:
    (reading,) = readings(encoders(), turned([10 * RESOLUTION], [-7 * RESOLUTION]))
    assert dict(zip(reading.names, reading.ticks, strict=True)) == {WHEELS[0]: 10, WHEELS[1]: -7}


@pytest.mark.parametrize("direction", [1, -1])
def test_one_count_for_each_resolution_forward_and_back_across_zero(direction: int) -> None:
    steps = np.concatenate([np.arange(-500, 501), np.arange(500, -501, -1)]) * direction
    angles = steps * RESOLUTION / 100
    ticks = counts(readings(encoders(), turned(angles)))[:, 0]
    assert set(np.diff(ticks).tolist()) == {-1, 0, 1}
    assert (ticks[0], ticks[1000]) == (-5 * direction, 5 * direction)
    assert np.abs(ticks - angles / RESOLUTION).max() <= 0.5 + 1e-9
    # The same lines are passed on the way back.
    inner = np.abs(steps[:1001] % 100 - 50) > 1  # Not on a line, where rounding decides.
    assert (ticks[:1001] == ticks[1001:][::-1])[inner].all()


def test_standing_still_at_zero_does_not_flicker() -> None:
    jitter = np.random.default_rng(2).normal(scale=0.05 * RESOLUTION, size=200)
    assert not counts(readings(encoders(), turned(jitter))).any()


def test_it_agrees_with_the_angle_and_with_the_papers_rule_to_one_tick() -> None:
    angles = np.cumsum(np.random.default_rng(4).normal(scale=2 * RESOLUTION, size=4000))
    ticks = counts(readings(encoders(), turned(angles)))[:, 0]
    assert np.abs(ticks - angles / RESOLUTION).max() <= 0.5 + 1e-9
    counted, remainder, last = 0, 0.0, 0.0
    for angle, tick in zip(angles, ticks, strict=True):
        remainder += angle - last
        last = angle
        while abs(remainder) >= RESOLUTION:
            counted += int(math.copysign(1, remainder))
            remainder -= math.copysign(RESOLUTION, remainder)
        assert abs(counted - tick) <= 1


def test_counters_are_64_bits_wide() -> None:
    angle = 2.0**33 * 2 * math.pi
    (reading,) = readings(encoders(), turned([angle], [-angle]))
    assert reading.ticks == (2**45, -(2**45))
    assert messages.decode(encode(reading), messages.WheelEncoders) == reading


def test_at_50_hz_stamps_are_20_ms_apart_from_zero_on() -> None:
    taken = readings(encoders(rate_hz=50), turned(np.zeros(81)))
    assert [r.stamp_nanos - EPOCH_NANOS for r in taken] == [i * 20_000_000 for i in range(11)]


@pytest.mark.parametrize("rate_hz", [30, 29.97, 90])
def test_between_two_ticks_the_counters_are_those_of_the_stamp(rate_hz: float) -> None:
    speed = 40.0  # rad/s: 65 counts a tick, so that a wrong instant shows.
    taken = readings(encoders(rate_hz=rate_hz), turned(speed * np.arange(400) / 400))
    assert len(taken) == math.floor(399 / 400 * rate_hz) + 1
    for reading in taken:
        angle = speed * (reading.stamp_nanos - EPOCH_NANOS) * 1e-9
        assert abs(reading.ticks[0] - angle / RESOLUTION) <= 0.5 + 1e-6


def test_a_state_without_the_wheels_is_refused() -> None:
    (state,) = turned([0.0])
    (other,) = states(np.zeros((1, 3)), joint_positions=[[0.0]])
    for vehicles, count in (({}, 0), (other.vehicles, 1)):
        with pytest.raises(BadBusMessage, match=f"tick 0: {count} joint positions of `rover`"):
            encoders().readings(replace(state, vehicles=vehicles))


def test_a_track_is_counted_by_its_sprocket() -> None:
    run = scenario()
    model = convert(read(SHIPPED / "vehicles" / "tank.yaml"), VehicleModel)
    tank = replace(run.vehicles[0], model=model)
    spec = Encoders(name="encoders", topic="/e", frame="base_link", rate_hz=400)
    sprocket_m = model.counted[0].radius_m
    way_m = 2 * math.pi * sprocket_m
    angles = [
        [0.0] * len(model.wheels),
        [(way_m if w.center_m[1] > 0 else -2 * way_m) / w.radius_m for w in model.wheels],
    ]
    taken = readings(
        EncodersModel(replace(run, vehicles=(tank,)), tank, spec),
        states(np.zeros((2, 3)), joint_positions=angles),
    )
    assert taken[-1].names == ("left_track", "right_track")
    assert taken[-1].ticks == (4096, -8192)
