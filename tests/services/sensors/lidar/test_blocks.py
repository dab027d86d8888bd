# SPDX-License-Identifier: Apache-2.0
"""A revolution in blocks is the revolution: the same points, earlier and in more messages."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest

from groundlink.core.clock import TICK_NANOS, TICK_SECONDS, Schedule
from groundlink.core.frames import multiply, quaternion_from_rpy
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import PointCloud, State, VehicleState, encode, packed
from groundlink.scenario.schema import Scenario
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.scanner import FiringBlocks
from services.sensors.scanning.sweep import Sweep

EPOCH_NANOS = 1_700_000_000_000_000_000
REVOLUTION_NANOS = 100_000_000
REVOLUTIONS = 3
SHEETS = ("vlp16", "vlp16_paper")
"""1808 firings, which 150 blocks do not divide evenly; 3600, whose firings overlap."""


@cache
def laboratory() -> Scenario:
    return load(SHIPPED / "indoor_lab.yaml")


def sheet(name: str, **changes: Any) -> Lidar:
    """Return a data sheet on the shipped rover's mast, with noise and loss."""
    text = (SHIPPED / "sensors" / f"{name}.yaml").read_bytes()
    document = msgspec.yaml.decode(text) | {"name": "lidar", "topic": "/points", "frame": "lidar"}
    mount = msgspec.to_builtins(laboratory().vehicles[0].sensors[0].mount)
    return msgspec.convert(document | {"mount": mount, "dropout": 0.05} | changes, Lidar)


def states(first_tick: int = 0, last_tick: int = REVOLUTIONS * 40) -> Iterator[State]:
    """Yield the states of a rover that drives a curve and nods, its wheels turning."""
    scenario = laboratory()
    for tick in range(first_tick, last_tick + 1):
        seconds = tick * TICK_SECONDS
        yaw = 0.7 * seconds
        turn = np.array(quaternion_from_rpy(0.02 * np.sin(9 * seconds), 0.03 * seconds, yaw))
        base = np.array([-4.6 + 0.9 * seconds, 0.2 * seconds**2, 0.165])
        rows = [[*base, *turn]]
        for wheel in scenario.vehicles[0].model.wheels:
            roll = multiply(turn, quaternion_from_rpy(0, 5 * seconds, 0))
            rows.append([*(base + np.array(wheel.center_m)), *roll])
        vehicle = VehicleState(
            link_poses=packed(np.array(rows)),
            base_velocity=packed(np.zeros(6)),
            joint_positions=packed(np.zeros(4)),
            joint_velocities=packed(np.zeros(4)),
        )
        sim_nanos = tick * TICK_NANOS
        yield State("test", EPOCH_NANOS, EPOCH_NANOS, tick, sim_nanos, "", {"rover": vehicle})


def clouds(spec: Lidar, first_tick: int = 0) -> list[tuple[int, PointCloud]]:
    """Return every cloud with the tick whose state completed it."""
    scenario = laboratory()
    model = LidarModel(scenario, scenario.vehicles[0], spec)
    return [(s.tick, cloud) for s in states(first_tick) for cloud in model.readings(s)]


@pytest.mark.parametrize("name", SHEETS)
@pytest.mark.parametrize("block_deg", [360.0, 90.0, 15.0, 2.4])
def test_blocks_one_after_the_other_are_the_revolution(name: str, block_deg: float) -> None:
    whole = [cloud for _, cloud in clouds(sheet(name, block_deg=0.0))]
    blocks = [cloud for _, cloud in clouds(sheet(name, block_deg=block_deg))]
    a_revolution = round(360 / block_deg)
    assert len(whole) == REVOLUTIONS
    assert len(blocks) == REVOLUTIONS * a_revolution
    for i, cloud in enumerate(whole):
        own = blocks[i * a_revolution : (i + 1) * a_revolution]
        assert own[0].stamp_nanos == cloud.stamp_nanos == EPOCH_NANOS + i * REVOLUTION_NANOS
        revolution, together = cloud.records(), np.concatenate([b.records() for b in own])
        assert len(together) == len(revolution) > 20_000
        for field in ("x", "y", "z", "intensity", "ring"):
            assert together[field].tobytes() == revolution[field].tobytes(), field
        seconds = np.concatenate(
            [(b.stamp_nanos - cloud.stamp_nanos) * 1e-9 + b.records()["time"] for b in own]
        )
        assert seconds == pytest.approx(revolution["time"], abs=2e-8)


STRAY: dict[str, Any] = {
    "mixed_pixels": True,
    "divergence_mrad": [3.0, 1.5],
    "blooming": {"share": 0.002, "width_mrad": 4.0},
    "echo_bands": {"intensity": [10, 60], "range_m": [1], "dropout": [[0.1], [0.0]]},
}


def test_blocks_of_beams_that_depend_on_neighbors_are_the_revolution() -> None:
    whole = [cloud for _, cloud in clouds(sheet("vlp16", **STRAY))]
    spec = sheet("vlp16", block_deg=3.0, **STRAY)
    blocks = clouds(spec)
    together = np.concatenate([cloud.records() for _, cloud in blocks])
    revolutions = np.concatenate([cloud.records() for cloud in whole])
    for field in ("x", "y", "z", "intensity", "ring"):
        assert together[field].tobytes() == revolutions[field].tobytes(), field
    plain = np.concatenate([cloud.records() for _, cloud in clouds(sheet("vlp16"))])
    assert abs(len(plain) - len(revolutions)) > 100
    sent = {cloud.stamp_nanos: encode(cloud) for _, cloud in blocks}
    for first_tick in (50, 80):
        later = {cloud.stamp_nanos: encode(cloud) for _, cloud in clouds(spec, first_tick)}
        assert later.items() <= sent.items()


def test_times_count_from_the_blocks_own_first_firing() -> None:
    for _, cloud in clouds(sheet("vlp16_paper", block_deg=15.0, dropout=0.0)):
        times = cloud.records()["time"]
        assert 0 <= times.min() < 1e-3
        assert times.max() < 0.1 / 24 + 35e-6


@pytest.mark.parametrize(("name", "block_deg"), [("vlp16", 2.4), ("vlp16_paper", 15.0)])
def test_a_successor_sends_every_block_that_was_not_settled(name: str, block_deg: float) -> None:
    spec, scenario = sheet(name, block_deg=block_deg), laboratory()
    whole = {cloud.stamp_nanos: encode(cloud) for _, cloud in clouds(spec)}
    for end_tick in (47, 50, 51, 79, 80, 81):
        model = LidarModel(scenario, scenario.vehicles[0], spec)
        sent = {made.stamp_nanos for s in states(0, end_tick) for made in model.readings(s)}
        later = {c.stamp_nanos: encode(c) for _, c in clouds(spec, model.settled_tick())}
        assert later.items() <= whole.items()
        assert sent | later.keys() == whole.keys()
        missing_nanos = min(whole.keys() - sent) - EPOCH_NANOS
        assert min(later) - EPOCH_NANOS >= missing_nanos // TICK_NANOS * TICK_NANOS


@pytest.mark.parametrize(("name", "block_deg"), [("vlp16", 2.4), ("vlp16_paper", 15.0)])
def test_a_block_leaves_with_the_first_state_after_its_last_ray(
    name: str, block_deg: float
) -> None:
    spec = sheet(name, block_deg=block_deg)
    blocks = FiringBlocks(spec, Sweep(spec))
    late_nanos = max(spec.laser_times_us) * 1000
    firing_nanos = REVOLUTION_NANOS / spec.firings_per_revolution
    for i, (tick, cloud) in enumerate(clouds(spec)):
        _, firings = blocks.firings(range(i, i + 1))
        start = cloud.stamp_nanos - EPOCH_NANOS
        last_ray = start + (len(firings) - 1) * firing_nanos + late_nanos
        next_firing = start + len(firings) * firing_nanos
        end = (
            next_firing if (i + 1) % spec.blocks_per_revolution == 0 else max(last_ray, next_firing)
        )
        assert end - 2 <= tick * TICK_NANOS < end + TICK_NANOS + 2


@pytest.mark.parametrize("rate_hz", [5.0, 9.97, 20.0])
@pytest.mark.parametrize("block_deg", [0.0, 15.0])
def test_blocks_do_not_drift(rate_hz: float, block_deg: float) -> None:
    spec = sheet("vlp16_paper", block_deg=block_deg, rotation_rate_hz=rate_hz)
    declared = Schedule.at(rate_hz)
    count = spec.blocks_per_revolution
    blocks = FiringBlocks(spec, Sweep(spec))
    assert spec.message_rate_hz == rate_hz * count
    for revolution in (0, 1, 77, 100_003):
        assert blocks.nanos(revolution * count) == declared.nanos(revolution)
        assert blocks.end_tick((revolution + 1) * count - 1) == declared.tick(revolution + 1)
    for tick in (0, 1, 39, 40, 12_345):
        block = blocks.at_or_after(tick * TICK_NANOS)
        assert blocks.nanos(block) >= tick * TICK_NANOS - 1
        assert block == 0 or blocks.nanos(block - 1) < tick * TICK_NANOS


@pytest.mark.parametrize("block_deg", [7.0, 0.05, 400.0, 100.0])
def test_a_block_that_does_not_divide_a_revolution_is_refused(block_deg: float) -> None:
    with pytest.raises(msgspec.ValidationError, match=r"`block_deg` is .* 360 divided by"):
        sheet("vlp16_paper", block_deg=block_deg)
