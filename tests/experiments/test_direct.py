# SPDX-License-Identifier: Apache-2.0
"""The direct tests find what was made wrong on purpose, and by how much, in a room of boxes."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.studies.direct import LidarSweep, imu_quantities, scan_quantities
from groundlink.data.trajectory import Trajectory
from groundlink.world.solids import Box, Solid

HALF_M = np.array([4.0, 3.0, 2.0])
TURN_RADPS = 1.0


def _room() -> list[Solid]:
    walls = []
    for i, axis in enumerate(np.eye(3)):
        for side in (-1.0, 1.0):
            x, y, z = (side * axis * (HALF_M + 0.1)).tolist()
            length, width, height = np.where(axis > 0, 0.2, 10.0).tolist()
            box = Box(size_m=(length, width, height))
            walls.append(Solid(f"{i}{side}", box, "stone", position_m=(x, y, z)))
    return walls


def _truth() -> Trajectory:
    """Return a sensor that drives at 0.3 m/s along x and turns."""
    seconds = np.arange(0.0, 4.0, 0.01)
    positions = np.stack([0.3 * seconds - 0.6, 0 * seconds, 0 * seconds], axis=1)
    yaw = TURN_RADPS * seconds
    turns = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)
    return Trajectory(seconds, positions, turns)


def _sweeps() -> list[LidarSweep]:
    """Return what it sees of the outer walls, each beam at its own instant."""
    sweeps = []
    for stamp in np.arange(0.5, 3.4, 0.1):
        times = np.linspace(0.0, 0.1, 2000, endpoint=False)
        azimuth = 2 * np.pi * times / 0.1
        elevation = 0.4 * np.sin(40 * azimuth + 0.1)
        beams = np.stack(
            [
                np.cos(azimuth) * np.cos(elevation),
                np.sin(azimuth) * np.cos(elevation),
                np.sin(elevation),
            ],
            axis=1,
        )
        instants = stamp + times
        yaw = TURN_RADPS * instants
        sine, cosine = np.sin(yaw), np.cos(yaw)
        world = np.stack(
            [
                cosine * beams[:, 0] - sine * beams[:, 1],
                sine * beams[:, 0] + cosine * beams[:, 1],
                beams[:, 2],
            ],
            axis=1,
        )
        start = np.stack([0.3 * instants - 0.6, 0 * instants, 0 * instants], axis=1)
        ranges = ((np.sign(world) * HALF_M - start) / world).min(axis=1)
        sweeps.append(LidarSweep(float(stamp), beams * ranges[:, None], times))
    return sweeps


def _values(sweeps: list[LidarSweep]) -> list[float]:
    return [q.value for q in scan_quantities(sweeps, _truth(), _room())]


def test_good_sweeps_lie_on_the_walls() -> None:
    told = scan_quantities(_sweeps(), _truth(), _room())
    assert all(quantity.holds for quantity in told), told
    distance_mm, late_ms, times, _, ranges = (quantity.value for quantity in told)
    assert distance_mm < 1.0
    assert late_ms == pytest.approx(0.0, abs=0.5)
    assert times == pytest.approx(1.0, abs=0.01)
    assert ranges == pytest.approx(1.0, abs=0.002)


def test_late_stamps_are_found_to_the_millisecond() -> None:
    late = [replace(sweep, stamp_s=sweep.stamp_s + 0.05) for sweep in _sweeps()]
    assert _values(late)[1] == pytest.approx(50.0, abs=1.0)


def test_long_ranges_are_found() -> None:
    long = [replace(sweep, points_m=sweep.points_m * 1.1) for sweep in _sweeps()]
    assert _values(long)[4] == pytest.approx(1 / 1.1, abs=0.003)


def test_times_of_another_unit_and_no_times_are_found() -> None:
    half = [replace(sweep, times_s=sweep.times_s / 2) for sweep in _sweeps()]
    none = [replace(sweep, times_s=sweep.times_s * 0) for sweep in _sweeps()]
    assert _values(half)[2] == pytest.approx(2.0, abs=0.02)
    assert not any(scan_quantities(none, _truth(), _room())[i].holds for i in (0, 2, 3))


def test_a_mirrored_scan_is_found() -> None:
    mirrored = [replace(sweep, points_m=sweep.points_m * (1, -1, 1)) for sweep in _sweeps()]
    assert not scan_quantities(mirrored, _truth(), _room())[0].holds


def test_an_imu_is_compared_with_the_true_motion() -> None:
    seconds = np.arange(0.2, 3.8, 0.0025)
    yaw = 0.5 * np.sin(2 * np.arange(0, 4, 0.01))
    turns = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)
    truth = replace(_truth(), orientations=turns)
    rates = np.zeros((len(seconds), 3))
    rates[:, 2] = np.cos(2 * seconds)
    forces = np.tile([0.0, 0.0, 9.81], (len(seconds), 1))
    good = imu_quantities(seconds, rates, forces, truth)
    assert all(quantity.holds for quantity in good), good
    assert imu_quantities(seconds, -rates, forces, truth)[0].value == pytest.approx(-1, abs=0.01)
    assert imu_quantities(seconds + 0.02, rates, forces, truth)[1].value == pytest.approx(20, abs=1)
    assert imu_quantities(seconds, rates, forces * 0, truth)[2].value == 0.0
