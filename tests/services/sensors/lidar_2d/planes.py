# SPDX-License-Identifier: Apache-2.0
"""The LiDAR tests' bare room, with a planar scanner on the cart."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.messages.imagery import LaserScan
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from services.sensors.lidar_2d.model import Lidar2dModel
from services.sensors.lidar_2d.spec import Lidar2d
from tests.services.sensors.lidar import rooms

MOUNT = Mount((0.1, 0.05, 0.5), (2.0, -3.0, 20.0))
"""Above the wheels."""

Floats = NDArray[np.float64]


def scenario(*, seed: int = 1, solids: Sequence[dict[str, Any]] = (), **scanner: Any) -> Scenario:
    """Return the room with one vehicle and one scanner."""
    made = rooms.scenario(seed=seed, solids=solids)
    place = {"name": "scanner", "topic": "/scan", "frame": "scan_link", "mount": MOUNT}
    spec = Lidar2d(**{**place, "firings_per_revolution": 720, **scanner})
    return replace(made, vehicles=(replace(made.vehicles[0], sensors=(spec,)),))


def model(made: Scenario) -> Lidar2dModel:
    spec = made.vehicles[0].sensors[0]
    assert isinstance(spec, Lidar2d)
    return Lidar2dModel(made, made.vehicles[0], spec)


def scans(made: Scenario, way: rooms.Way = rooms.at_rest, ticks: int = 42) -> list[LaserScan]:
    """Return what a fresh model measures."""
    scanner = model(made)
    return [scan for state in rooms.states(made, way, ticks) for scan in scanner.readings(state)]


def ranges(scan: LaserScan) -> Floats:
    return np.frombuffer(scan.ranges_m, np.float32).astype(np.float64)


def seconds(scan: LaserScan) -> Floats:
    """Return the sim time of each ray, as the message says it."""
    start = (scan.stamp_nanos - rooms.EPOCH_NANOS) * 1e-9
    return start + np.arange(len(ranges(scan))) * scan.time_increment_s


def directions(scan: LaserScan) -> Floats:
    """Return the direction of each ray in the sensor's frame, as the message says it."""
    angles = scan.angle_min_rad + np.arange(len(ranges(scan))) * scan.angle_increment_rad
    return np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=-1)


def exact_ranges(scan: LaserScan, way: rooms.Way) -> Floats:
    """Return how far the room's walls are along each ray, at its own instant."""
    poses = [way(t) for t in seconds(scan)]
    world_from_base = matrix_from_quaternion([quaternion_from_rpy(*rpy) for _, rpy in poses])
    base_from_sensor = matrix_from_quaternion(quaternion_from_rpy(*MOUNT.rpy_radians()))
    origins = np.array([at for at, _ in poses]) + world_from_base @ np.array(MOUNT.xyz_m)
    rays = np.einsum("nij,jk,nk->ni", world_from_base, base_from_sensor, directions(scan))
    with np.errstate(divide="ignore"):
        to_planes = (np.sign(rays) * rooms.HALF - (origins - rooms.MIDDLE)) / rays
    distances: Floats = np.min(to_planes, axis=1)
    return distances


def points_in_world(scan: LaserScan, way: rooms.Way, at_seconds: Floats) -> Floats:
    """Return where the returns are, each from the pose that the vehicle has at some instant."""
    mount = {"xyz_m": MOUNT.xyz_m, "rpy_deg": MOUNT.rpy_deg}
    return rooms.in_world(way, at_seconds, ranges(scan)[:, None] * directions(scan), mount)
