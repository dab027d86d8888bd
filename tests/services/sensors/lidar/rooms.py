# SPDX-License-Identifier: Apache-2.0
"""A bare room with a cart in it, and states in which the cart goes as a test says."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_NANOS, TICK_SECONDS
from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.messages.base import PointCloud, State, VehicleState, packed
from groundlink.scenario.schema import Scenario
from services.sensors.lidar.model import LidarModel
from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.scanner import Scan

EPOCH_NANOS = 1_700_000_000_000_000_000
HALF = np.array([5.0, 4.0, 1.5])
"""Of the room, whose middle is at (0, 0, 1.5)."""

MIDDLE = np.array([0.0, 0.0, 1.5])
MATERIALS = {
    **{"x": {"reflectivity": 0.8}, "y": {"reflectivity": 0.6}, "z": {"reflectivity": 0.4}},
    **{"dark": {"reflectivity": 0.1}, "rubber": {"reflectivity": 0.05}},
}
WHEELS = ((0.3, 0.1, 0.0), (0.3, -0.1, 0.0), (-0.3, 0.0, 0.0))

Floats = NDArray[np.float64]
Way = Callable[[float], tuple[Sequence[float], Sequence[float]]]
"""From sim seconds to position and roll, pitch, yaw of the base in the world."""


def at_rest(_: float) -> tuple[Sequence[float], Sequence[float]]:
    return (0.3, -0.2, 0.6), (0.0, 0.0, 0.4)


def driving(*, speed_mps: float, turn_radps: float) -> Way:
    """Straight along x while turning on the spot, and swaying a little."""

    def way(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return (-1 + speed_mps * t, 0.5 * t, 0.6), (0.02 * np.sin(9 * t), 0.1 * t, turn_radps * t)

    return way


def walls() -> list[dict[str, Any]]:
    """Six slabs, 1 m thick, around the room; each axis has a material of its own name."""
    slabs = []
    for axis, name in enumerate("xyz"):
        for side in (-1, 1):
            size, position = 2 * HALF + 2, MIDDLE.copy()
            size[axis] = 1.0
            position[axis] += side * (HALF[axis] + 0.5)
            slabs.append(
                {
                    "name": f"{name}{side}",
                    "shape": {"kind": "box", "size_m": size.tolist()},
                    "material": name,
                    "position_m": position.tolist(),
                }
            )
    return slabs


def scenario(
    *,
    seed: int = 1,
    visuals: Sequence[dict[str, Any]] = (),
    solids: Sequence[dict[str, Any]] = (),
    others: Sequence[dict[str, Any]] = (),
    **lidar: Any,
) -> Scenario:
    """Return a scenario with the vehicle `rover`; `others` are a visual of one more each."""
    wheel = {"radius_m": 0.1, "width_m": 0.06, "mass_kg": 1}
    spec = {
        **{"kind": "lidar", "name": "lidar", "topic": "/points", "frame": "lidar_link"},
        "elevations_deg": np.arange(-15.0, 16.0, 2.0).tolist(),
        "firings_per_revolution": 360,
        **lidar,
    }

    def vehicle(name: str, looks: Sequence[dict[str, Any]], sensors: list[Any]) -> dict[str, Any]:
        drive = {"kind": "skid_steer", "max_wheel_torque_nm": 10, "max_wheel_speed_radps": 10}
        model = {
            "name": "cart",
            "chassis": {"mass_kg": 10, "size_m": [0.1, 0.1, 0.1], "center_m": [0, 0, 1]},
            "suspension": {},
            "wheels": [{"name": f"w{i}", "center_m": at, **wheel} for i, at in enumerate(WHEELS)],
            "drive": drive,
            "visuals": looks,
        }
        vehicle = {"name": name, "frame_prefix": f"{name}/", "model": model, "sensors": sensors}
        return {**vehicle, "placement": {"x_m": len(name) - 5.0}}

    document = {
        "name": "test",
        "seed": seed,
        "world": {"name": "room", "materials": MATERIALS, "solids": [*walls(), *solids]},
        "vehicles": [
            vehicle("rover", visuals, [spec]),
            *(vehicle(f"other{i}", [looks], []) for i, looks in enumerate(others)),
        ],
    }
    return msgspec.convert(document, Scenario)


def states(
    scenario: Scenario,
    way: Way,
    ticks: int,
    *,
    first_tick: int = 0,
    others: Sequence[Way] = (),
    links: int | None = None,
    signs: Sequence[int] = (1,),
) -> Iterator[State]:
    """Yield states; every vehicle goes its own way, the first as `way` says.

    Quaternions of successive ticks are multiplied by `signs`, which turns nothing.
    """
    for tick in range(first_tick, first_tick + ticks):
        vehicles = {}
        for vehicle, its_way in zip(scenario.vehicles, (way, *others), strict=True):
            position, rpy = its_way(tick * TICK_SECONDS)
            turn = quaternion_from_rpy(*rpy)
            rotation = matrix_from_quaternion(turn)
            same_turn = signs[tick % len(signs)] * np.array(turn)
            poses = [[*(position + rotation @ at), *same_turn] for at in ((0, 0, 0), *WHEELS)]
            none = packed(np.zeros(0))
            vehicles[vehicle.name] = VehicleState(
                packed(np.array(poses[:links])), packed(np.zeros(6)), none, none
            )
        yield State("test", EPOCH_NANOS, EPOCH_NANOS, tick, tick * TICK_NANOS, "", vehicles)


def model(made: Scenario) -> LidarModel:
    """Return the model of the rover's LiDAR."""
    spec = made.vehicles[0].sensors[0]
    assert isinstance(spec, Lidar)
    return LidarModel(made, made.vehicles[0], spec)


def clouds(made: Scenario, way: Way, ticks: int = 42, **states_as: Any) -> list[PointCloud]:
    """Return what a fresh model measures."""
    sensor = model(made)
    fed = states(made, way, ticks, **states_as)
    return [cloud for state in fed for cloud in sensor.readings(state)]


def scans(made: Scenario, way: Way, ticks: int = 42, **states_as: Any) -> list[Scan]:
    """Return what a fresh scanner takes."""
    scanner = model(made).scanner
    return [scan for state in states(made, way, ticks, **states_as) for scan in scanner.take(state)]


def points(cloud: PointCloud) -> Floats:
    """Return the points, shape (N, 3), in the sensor's frame."""
    records = cloud.records()
    return np.stack([records[axis] for axis in "xyz"], axis=-1).astype(np.float64)


def sim_seconds(cloud: PointCloud) -> Floats:
    """Return the instant of each point."""
    return (cloud.stamp_nanos - EPOCH_NANOS) * 1e-9 + cloud.records()["time"].astype(np.float64)


def in_frame_of(way: Way, seconds: Floats, points_in_world: Floats) -> Floats:
    """Return points in the base of a vehicle, as it stands at the instant of each."""
    poses = [way(t) for t in seconds]
    rotations = matrix_from_quaternion([quaternion_from_rpy(*rpy) for _, rpy in poses])
    offsets = points_in_world - np.array([position for position, _ in poses])
    return np.einsum("nji,nj->ni", rotations, offsets)


def in_world(
    way: Way, seconds: Floats, points_in_sensor: Floats, mount: dict[str, Any] | None = None
) -> Floats:
    """Return points in the world, by the vehicle's true pose at the instant of each."""
    mount = mount or {}
    base_from_sensor = matrix_from_quaternion(
        quaternion_from_rpy(*np.radians(mount.get("rpy_deg", (0, 0, 0))))
    )
    in_base = points_in_sensor @ base_from_sensor.T + mount.get("xyz_m", (0, 0, 0))
    poses = [way(t) for t in seconds]
    rotations = matrix_from_quaternion([quaternion_from_rpy(*rpy) for _, rpy in poses])
    return np.einsum("nij,nj->ni", rotations, in_base) + np.array([p for p, _ in poses])


def off_the_walls(points_in_world: Floats) -> Floats:
    """Return how far each point is from the nearest wall, floor or ceiling."""
    return np.min(np.abs(HALF - np.abs(points_in_world - MIDDLE)), axis=1)
