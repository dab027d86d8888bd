# SPDX-License-Identifier: Apache-2.0
"""Points of a moving sensor land where they were measured."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from groundlink.core.clock import TICK_NANOS
from groundlink.core.frames import transform
from services.view.point_placement import PoseHistory, points_in_world

STAMP = 1_700_000_000_000_000_000


def history(ticks: int, *, speed: float, turn: float, depth: int = 2000) -> PoseHistory:
    """Return a body that drives at `speed` m/s along x and turns at `turn` rad/s."""
    poses = PoseHistory(depth)
    for tick in range(ticks):
        seconds = tick * TICK_NANOS * 1e-9
        turned = Rotation.from_euler("z", turn * seconds).as_quat()
        poses.add(STAMP + tick * TICK_NANOS, np.array([speed * seconds, 5, 0.2, *turned]))
    return poses


def test_a_wall_seen_while_driving_and_turning_stays_one_wall() -> None:
    """Points of a wall at x = 9, each given in the sensor's frame of its own instant."""
    generator = np.random.default_rng(3)
    seconds = np.sort(generator.uniform(0.0, 0.1, 4000)).astype(np.float32)
    wall = np.stack([np.full(4000, 9.0), *generator.uniform(-3, 3, (2, 4000))], axis=-1)
    base_from_sensor = transform((0.1, 0.2, 0.6), (0.0, 0.0, np.sin(0.2), np.cos(0.2)))
    speed, turn, begin = 1.0, 1.5, 10
    ticks = np.arange(100) * TICK_NANOS * 1e-9
    at = begin * TICK_NANOS * 1e-9 + seconds
    turned = Slerp(ticks, Rotation.from_euler("z", turn * ticks[:, None]))(at).as_matrix()
    position = np.stack([speed * at, np.full(4000, 5.0), np.full(4000, 0.2)], axis=-1)
    in_base = np.einsum("nji,nj->ni", turned, wall - position)
    in_sensor = (in_base - base_from_sensor[:3, 3]) @ base_from_sensor[:3, :3]

    base = history(100, speed=speed, turn=turn)
    stamp = STAMP + begin * TICK_NANOS
    placed = points_in_world(in_sensor.astype(np.float32), seconds, stamp, base, base_from_sensor)
    assert placed is not None
    assert np.abs(placed - wall).max() < 1e-4

    shuffled = generator.permutation(4000)
    again = points_in_world(
        in_sensor[shuffled].astype(np.float32), seconds[shuffled], stamp, base, base_from_sensor
    )
    assert again is not None
    assert np.abs(again - wall[shuffled]).max() < 1e-4


def test_by_the_pose_at_the_stamp_alone_it_would_be_torn() -> None:
    """What the interpolation is for: the last point of a revolution is 10 cm off without it."""
    seconds = np.array([0.0, 0.1], np.float32)
    points = np.array([[2.0, 0, 0], [1.9, 0, 0]], np.float32)  # the same wall, 10 cm later
    placed = points_in_world(points, seconds, STAMP, history(60, speed=1.0, turn=0.0), np.eye(4))
    assert placed is not None
    assert placed[:, 0] == pytest.approx([2.0, 2.0], abs=1e-5)


@pytest.mark.parametrize(
    ("first", "last", "known"), [(0, 59, True), (-1, 10, False), (50, 60, False), (59, 59, True)]
)
def test_what_is_not_known_is_not_placed(first: int, last: int, known: bool) -> None:
    span = history(60, speed=1, turn=0).span(STAMP + first * TICK_NANOS, STAMP + last * TICK_NANOS)
    assert (span is not None) == known
    if span is not None:
        assert span[0][0] <= STAMP + first * TICK_NANOS
        assert span[0][-1] >= STAMP + last * TICK_NANOS
        assert len(span[0]) >= 2


def test_the_history_is_bounded_and_keeps_the_newest() -> None:
    poses = history(1000, speed=1, turn=0, depth=64)
    assert poses.span(STAMP, STAMP) is None
    span = poses.span(STAMP + 940 * TICK_NANOS, STAMP + 999 * TICK_NANOS)
    assert span is not None
    assert set(np.diff(span[0]).tolist()) == {TICK_NANOS}


def test_no_points_are_no_points() -> None:
    none = np.empty((0, 3), np.float32)
    placed = points_in_world(none, none[:, 0], STAMP, PoseHistory(), np.eye(4))
    assert placed is not None
    assert placed.shape == (0, 3)
