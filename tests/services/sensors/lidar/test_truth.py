# SPDX-License-Identifier: Apache-2.0
"""The truth behind a cloud: its points as they are at its stamp, and the bodies they are on."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.messages.base import POINT, PointCloud
from groundlink.messages.ground_truth import TRUE_POINT, TruePoints
from groundlink.scenario.schema import Scenario
from groundlink.scene.bodies import NO_BODY, body_names
from groundlink.scene.build import solids
from groundlink.world.weather import Weather
from services.sensors.runtime.model import stream_and_message

from . import rooms

CAR = {
    "name": "hull",
    "shape": {"kind": "box", "size_m": [1.2, 0.8, 1.0]},
    "material": "dark",
    "position_m": [0.0, 0.0, 0.5],
}
CAR_HALF = np.array([0.6, 0.4, 0.5])
MOUNT = {"xyz_m": [0.1, -0.05, 0.4], "rpy_deg": [3.0, -2.0, 40.0]}
NOISY = {"range_stddev_m": 0.03, "laser_bias_m": 0.02, "range_resolution_m": 0.002, "dropout": 0.1}
WIDE = {
    **{"divergence_mrad": [9.0, 9.0], "rays_per_beam": 4, "returns": "dual"},
    **{"azimuth_stddev_deg": 0.2, "elevation_stddev_deg": 0.2},
}
"""Beams that point elsewhere than they are reported, and meet several things."""

WALLS = [f"{axis}{side}" for axis in "xyz" for side in (-1, 1)]
WITHIN_M = 1e-4

Floats = NDArray[np.float64]
Pairs = list[tuple[PointCloud, TruePoints]]


def ego(t: float) -> Any:
    return rooms.driving(speed_mps=2.0, turn_radps=1.5)(t)


def car(t: float) -> Any:
    """A car that crosses in front, fast, and turns."""
    return (2.0 + 0.5 * t, -2.0 + 9.0 * t, 0.1), (0.0, 0.0, 0.3 + 2.5 * t)


def world(**lidar: Any) -> Scenario:
    lidar = {"mount": MOUNT, "firings_per_revolution": 360, **lidar}
    return rooms.scenario(others=[CAR], **lidar)


def pairs(made: Scenario, ticks: int = 82) -> Pairs:
    """Return the clouds of a fresh model, each with its truth."""
    sensor = rooms.model(made)
    fed = rooms.states(made, ego, ticks, others=[car])
    said = [message for state in fed for message in sensor.readings(state)]
    assert {output for output, _ in map(stream_and_message, said[1::2])} == {"truth"}
    clouds, truths = said[::2], [message for _, message in map(stream_and_message, said[1::2])]
    assert clouds, "no cloud"
    assert {type(cloud) for cloud in clouds} == {PointCloud}
    assert {type(truth) for truth in truths} == {TruePoints}
    return list(zip(clouds, truths, strict=True))  # type: ignore[arg-type]


def in_world(cloud: PointCloud | TruePoints, seconds: Floats | float) -> Floats:
    """Return points in the world, if each was measured at its instant."""
    places = rooms.points(cloud)  # type: ignore[arg-type]
    return rooms.in_world(ego, np.broadcast_to(seconds, len(places)), places, MOUNT)


def stamp_seconds(message: PointCloud | TruePoints) -> float:
    return (message.stamp_nanos - rooms.EPOCH_NANOS) * 1e-9


def on(made: Scenario, truth: TruePoints, name: str) -> NDArray[np.bool_]:
    """Return which points are on a body, by its name."""
    number = body_names(made, solids(made)).index(name)
    return truth.records()["body"] == number


def off_the_box(points: Floats) -> Floats:
    """Return how far points, in the frame of the car, are off its surface."""
    over = np.abs(points - CAR["position_m"]) - CAR_HALF
    outside = np.linalg.norm(np.maximum(over, 0), axis=1)
    return outside - np.minimum(over.max(axis=1), 0)


@pytest.mark.parametrize("block_deg", [0.0, 8.0])
@pytest.mark.parametrize("errors", [{}, NOISY, WIDE], ids=["ideal", "noisy", "wide"])
def test_what_stands_still_is_where_it_is_and_seen_from_one_place(
    errors: dict[str, Any], block_deg: float
) -> None:
    made = world(truth=True, block_deg=block_deg, **errors)
    seen = 0
    for _, truth in pairs(made):
        here = in_world(truth, stamp_seconds(truth))
        for name in WALLS:
            axis, side = "xyz".index(name[0]), int(name[1:])
            of_wall = on(made, truth, name)
            expected = rooms.MIDDLE[axis] + side * rooms.HALF[axis]
            np.testing.assert_allclose(here[of_wall][:, axis], expected, rtol=0, atol=WITHIN_M)
            seen += np.count_nonzero(of_wall)
    assert seen > 5000


@pytest.mark.parametrize("errors", [{}, NOISY], ids=["ideal", "noisy"])
def test_the_cloud_is_the_truth_with_motion_and_noise(errors: dict[str, Any]) -> None:
    """Each point of it is seen from where the sensor was at its own instant."""
    made = world(truth=True, **errors)
    for cloud, truth in pairs(made):
        still = np.any([on(made, truth, name) for name in WALLS], axis=0)
        seconds = rooms.sim_seconds(cloud)
        there = in_world(cloud, seconds)[still]
        error = there - in_world(truth, stamp_seconds(truth))[still]
        if not errors:
            assert np.abs(error).max() < WITHIN_M
            continue
        ray = there - rooms.in_world(ego, seconds[still], np.zeros_like(there), MOUNT)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        along = np.sum(error * ray, axis=1)
        assert np.abs(error - along[:, None] * ray).max() < WITHIN_M
        rings = cloud.records()["ring"][still]
        along -= np.array([along[rings == ring].mean() for ring in range(16)])[rings]
        assert np.std(along) == pytest.approx(NOISY["range_stddev_m"], rel=0.1)


@pytest.mark.parametrize("block_deg", [0.0, 8.0])
@pytest.mark.parametrize("errors", [{}, WIDE], ids=["ideal", "wide"])
def test_a_point_on_a_moving_body_goes_with_it_to_the_stamp(
    errors: dict[str, Any], block_deg: float
) -> None:
    made = world(truth=True, block_deg=block_deg, **errors)
    seen, torn = 0, 0.0
    for cloud, truth in pairs(made):
        on_car = on(made, truth, "other0/base_link")
        if not on_car.any():
            continue  # a block that looks elsewhere
        stamp = np.full(np.count_nonzero(on_car), stamp_seconds(truth))
        there = rooms.in_frame_of(car, stamp, in_world(truth, stamp_seconds(truth))[on_car])
        assert np.all(off_the_box(there) < WITHIN_M)
        swept = in_world(cloud, rooms.sim_seconds(cloud))[on_car]
        seen += len(swept)
        torn = max([torn, *off_the_box(rooms.in_frame_of(car, stamp, swept))])
    assert seen > 200
    assert torn > (0.05 if not block_deg else 0.002), "the car hardly moved"


def test_wheels_turn_under_their_points() -> None:
    """The cart's own wheels, seen from above, and those of the car."""
    made = world(truth=True, elevations_deg=[-80.0, -50.0, -20.0, 0.0])
    for _, truth in pairs(made):
        here = in_world(truth, stamp_seconds(truth))
        found = set()
        for name, way in (("rover", ego), ("other0", car)):
            for i, at in enumerate(rooms.WHEELS):
                mine = on(made, truth, f"{name}/w{i}_link")
                if not mine.any():
                    continue
                stamp = np.full(np.count_nonzero(mine), stamp_seconds(truth))
                off = rooms.in_frame_of(way, stamp, here[mine]) - at
                assert np.all(np.hypot(off[:, 0], off[:, 2]) < 0.1 + WITHIN_M)
                assert np.all(np.abs(off[:, 1]) < 0.03 + WITHIN_M)
                found.add((name, i))
        assert {("rover", 0), ("rover", 1)} <= found


@pytest.mark.parametrize("errors", [NOISY, WIDE], ids=["noisy", "wide"])
def test_it_is_the_same_points_in_the_same_order(errors: dict[str, Any]) -> None:
    for cloud, truth in pairs(world(truth=True, **errors)):
        records, true = cloud.records(), truth.records()
        assert (truth.stamp_nanos, truth.frame) == (cloud.stamp_nanos, cloud.frame)
        assert len(true) == len(records)
        assert true.dtype == TRUE_POINT
        for name in set(POINT.names or ()) - set("xyz"):
            np.testing.assert_array_equal(true[name], records[name])
        apart = np.linalg.norm(rooms.points(truth) - rooms.points(cloud), axis=1)  # type: ignore[arg-type]
        assert np.median(apart) > 0.01


def test_fog_is_no_body_and_is_seen_where_it_is() -> None:
    made = world(truth=True, full_range_reflectivity=0.01)
    foggy = replace(made, world=replace(made.world, weather=Weather(fog_visibility_m=30.0)))
    for cloud, truth in pairs(foggy):
        fog = truth.records()["body"] == NO_BODY
        assert 0.01 < fog.mean() < 1
        here, seconds = in_world(truth, stamp_seconds(truth)), rooms.sim_seconds(cloud)
        np.testing.assert_allclose(here[fog], in_world(cloud, seconds)[fog], atol=WITHIN_M)
        assert rooms.off_the_walls(here[fog]).max() > 0.5


def test_it_changes_no_cloud_and_comes_with_the_same_bytes_again() -> None:
    made = world(truth=True, **NOISY)
    first, again = pairs(made), pairs(made)
    assert first == again
    alone = rooms.clouds(world(**NOISY), ego, 82, others=[car])
    assert alone == [cloud for cloud, _ in first]
