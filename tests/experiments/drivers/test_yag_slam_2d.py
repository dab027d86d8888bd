# SPDX-License-Identifier: Apache-2.0
"""What is done to scans before yag-slam gets them: chosen, and straightened by odometry."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.drivers.yag_slam_2d import (
    OdometryTrack,
    choose,
    compose,
    counterclockwise,
    invert,
    middle_s,
    straightened,
)

COUNT, STEP = 721, math.radians(0.25)
SCAN_S = 0.05
ROOM_M = 3.0
MOUNT = (0.3, 0.1, 0.2)


def scan_of(pose_at: Any, *, start_s: float) -> Any:
    """A scan in a square room around the origin, each ray from where the scanner was then."""
    angles = -math.pi / 2 + STEP * np.arange(COUNT)
    ranges = []
    for number, angle in enumerate(angles):
        x, y, yaw = pose_at(start_s + SCAN_S * number / COUNT)
        c, s = math.cos(yaw + angle), math.sin(yaw + angle)
        to_x = (math.copysign(ROOM_M, c) - x) / c if c else math.inf
        to_y = (math.copysign(ROOM_M, s) - y) / s if s else math.inf
        ranges.append(min(to_x, to_y))
    stamp = SimpleNamespace(sec=int(start_s), nanosec=round(start_s % 1 * 1e9))
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp),
        angle_min=-math.pi / 2,
        angle_increment=STEP,
        time_increment=SCAN_S / COUNT,
        range_min=0.1,
        ranges=np.array(ranges, np.float32),
    )


def base(seconds: float) -> tuple[float, float, float]:
    """A fast robot that turns."""
    return 0.4 * seconds, -0.2 * seconds, 1.5 * seconds


def scanner(seconds: float) -> tuple[float, float, float]:
    return compose(base(seconds), MOUNT)


def test_poses_chain_and_turn_back() -> None:
    a, b = (1.0, 2.0, 0.3), (-0.5, 0.2, 1.1)
    assert compose(invert(a), compose(a, b)) == pytest.approx(b)


def test_a_swept_scan_becomes_one_of_a_scanner_that_stands() -> None:
    odometry = OdometryTrack([(t, *base(t)) for t in np.arange(0.0, 2.0, 0.02)])
    swept = scan_of(scanner, start_s=0.613)
    middle = scanner(middle_s(swept))
    still = scan_of(lambda seconds: middle, start_s=0.613)
    assert np.abs(swept.ranges - still.ranges).max() > 0.05
    found = np.array(straightened(swept, odometry, MOUNT, 12.0))
    hit = found < 100.0  # directions that the sweep has seen
    assert hit.mean() > 0.9
    off = np.abs(found - still.ranges)[hit]
    assert np.median(off) < 0.005
    assert np.quantile(off, 0.95) < 0.02


def test_a_scan_that_turns_clockwise_is_turned_round() -> None:
    angles = (-1.0, 0.5, 0.5)
    assert counterclockwise([1.0, 2.0, 3.0, 4.0], -1.0, 0.5) == ([1.0, 2.0, 3.0, 4.0], *angles)
    assert counterclockwise([4.0, 3.0, 2.0, 1.0], 0.5, -0.5) == ([1.0, 2.0, 3.0, 4.0], *angles)


def test_odometry_is_interpolated_and_stands_at_its_ends() -> None:
    odometry = OdometryTrack([(1.0, 0.0, 0.0, 3.1), (2.0, 1.0, 2.0, -3.1)])
    assert odometry.at(0.0) == pytest.approx((0.0, 0.0, 3.1))
    assert odometry.at(1.5) == pytest.approx((0.5, 1.0, math.pi))
    assert odometry.at(9.0) == pytest.approx((1.0, 2.0, 2 * math.pi - 3.1))


def test_a_scan_is_taken_after_a_way_or_a_turn() -> None:
    poses = [(0.04 * i, 0.0, 0.0) for i in range(10)]
    poses += [(0.36, 0.0, 0.05 * i) for i in range(1, 5)]
    assert choose(poses, 0.1, 0.09) == [0, 3, 6, 9, 11, 13]
