# SPDX-License-Identifier: Apache-2.0
"""Where points are: each ray from its own instant's pose, against planes that are known exactly."""

from typing import Any

import numpy as np
import pytest

from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy

from . import rooms

TIMES_US = [2.304 * (2 * k if k < 8 else 2 * (k - 8) + 1) for k in range(16)]
OFFSETS_M = [0.01 - 0.001 * k for k in range(16)]
ABOVE = {"xyz_m": [0.0, 0.0, 0.4]}
"""Clear of the vehicle's wheels."""

MOUNT = {"xyz_m": [0.2, -0.1, 0.4], "rpy_deg": [3.0, -5.0, 40.0]}


def to_the_walls(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Ranges of rays, shape (N, 3), from inside the room to its six planes."""
    with np.errstate(divide="ignore"):
        ahead = (np.sign(directions) * rooms.HALF - (origins - rooms.MIDDLE)) / directions
    return np.min(np.where(directions == 0, np.inf, ahead), axis=1)


@pytest.mark.parametrize("firings", [360, 1808])
def test_every_ray_of_a_sensor_at_rest(firings: int) -> None:
    """Range, direction, order, ring, time and intensity of all rays, from the data sheet alone."""
    made = rooms.scenario(
        firings_per_revolution=firings,
        laser_times_us=TIMES_US,
        vertical_offsets_m=OFFSETS_M,
        mount=MOUNT,
    )
    (cloud,) = rooms.clouds(made, rooms.at_rest, 41)
    records = cloud.records()

    order = np.argsort(TIMES_US)
    firing, turn = np.divmod(np.arange(16 * firings), 16)
    ring = order[turn]
    time = firing * (0.1 / firings) + np.array(TIMES_US)[ring] * 1e-6
    # Clockwise from x: the azimuth grows to the right.
    azimuth, elevation = 2 * np.pi * time / 0.1, np.radians(-15.0 + 2 * ring)
    local = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            -np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=-1,
    )
    up = np.outer(np.array(OFFSETS_M)[ring], [0, 0, 1])
    origin = rooms.in_world(rooms.at_rest, time, up, MOUNT)
    direction = rooms.in_world(rooms.at_rest, time, up + local, MOUNT) - origin
    range_m = to_the_walls(origin, direction)

    np.testing.assert_array_equal(records["ring"], ring)
    np.testing.assert_allclose(records["time"], time, atol=1e-8)
    np.testing.assert_allclose(rooms.points(cloud), range_m[:, None] * local + up, atol=1e-5)
    hit = origin + range_m[:, None] * direction
    wall = np.argmin(np.abs(rooms.HALF - np.abs(hit - rooms.MIDDLE)), axis=1)
    cosine = np.abs(direction[np.arange(len(wall)), wall])
    expected = 100 * np.array([0.8, 0.6, 0.4])[wall] * cosine
    assert np.abs(records["intensity"] - expected).max() < 0.5 + 1e-3
    np.testing.assert_array_equal(records["intensity"], np.rint(records["intensity"]))


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 15.0])
def test_rolling_shutter(rate_hz: float) -> None:
    """A turning, driving sensor sees the walls where they are, ray by ray, and not otherwise."""
    way = rooms.driving(speed_mps=3.0, turn_radps=4.0)
    made = rooms.scenario(
        rotation_rate_hz=rate_hz,
        laser_times_us=TIMES_US,
        vertical_offsets_m=OFFSETS_M,
        mount=MOUNT,
    )
    seen = rooms.clouds(made, way, 130)
    assert len(seen) == int(129 * rate_hz / 400)
    for cloud in seen:
        points, seconds = rooms.points(cloud), rooms.sim_seconds(cloud)
        assert len(points) == 360 * 16
        # Tight enough to tell lasers of one firing apart: 20 us are 0.4 mm here.
        assert rooms.off_the_walls(rooms.in_world(way, seconds, points, MOUNT)).max() < 1e-4
        one_pose = np.full_like(seconds, seconds.mean())
        assert rooms.off_the_walls(rooms.in_world(way, one_pose, points, MOUNT)).max() > 0.05
        # A single tick off would show as well.
        late = seconds + 0.0025
        assert rooms.off_the_walls(rooms.in_world(way, late, points, MOUNT)).max() > 5e-3


def test_a_quaternion_and_its_negative_are_one_orientation() -> None:
    way = rooms.driving(speed_mps=3.0, turn_radps=4.0)
    made = rooms.scenario(mount=ABOVE)
    (cloud,) = rooms.clouds(made, way, 41)
    (same,) = rooms.clouds(made, way, 41, signs=(1, -1, -1))
    np.testing.assert_allclose(rooms.points(cloud), rooms.points(same), atol=1e-5)


def test_last_lasers_may_fire_after_the_last_state() -> None:
    """3600 firings a revolution: lasers of the last one are up to 7 us past the end."""
    way = rooms.driving(speed_mps=3.0, turn_radps=4.0)
    made = rooms.scenario(firings_per_revolution=3600, laser_times_us=TIMES_US, mount=ABOVE)
    (cloud,) = rooms.clouds(made, way, 41)
    seconds = rooms.sim_seconds(cloud)
    assert len(seconds) == 57600
    assert 0.1 < seconds.max() < 0.1 + 1e-5
    assert (
        rooms.off_the_walls(rooms.in_world(way, seconds, rooms.points(cloud), ABOVE)).max() < 1e-3
    )


def passing(t: float) -> tuple[Any, Any]:
    return (-1.5 + 15.0 * t, 1.5, 0.8), (0.0, 0.0, 5.0 * t)


def test_another_vehicle_is_where_it_is_at_each_rays_instant() -> None:
    size = np.array([0.8, 0.5, 1.2])
    hull = {"name": "hull", "shape": {"kind": "box", "size_m": size.tolist()}, "material": "dark"}
    made = rooms.scenario(others=[hull], firings_per_revolution=3600, mount=ABOVE)

    def turned(t: float) -> tuple[Any, Any]:
        return (0.0, 0.0, 0.8), (0.0, 0.0, -2.0)

    (cloud,) = rooms.clouds(made, turned, 41, others=[passing])
    seconds = rooms.sim_seconds(cloud)
    in_world = rooms.in_world(turned, seconds, rooms.points(cloud), ABOVE)
    on_it = rooms.off_the_walls(in_world) > 0.01
    assert on_it.sum() > 500

    def off_its_surface(at: np.ndarray) -> np.ndarray:
        outside = np.abs(rooms.in_frame_of(passing, at[on_it], in_world[on_it])) - size / 2
        return np.abs(outside.max(axis=1))

    # Its wheels reach beyond the hull's ends, so leave out what is seen of them.
    reach = rooms.in_frame_of(passing, seconds[on_it], in_world[on_it])
    hull_points = np.abs(reach[:, 2]) > 0.11
    assert hull_points.sum() > 300
    assert off_its_surface(seconds)[hull_points].max() < 1e-3
    assert off_its_surface(np.full_like(seconds, 0.05))[hull_points].max() > 0.05
    assert set(cloud.records()["intensity"][on_it]) <= set(range(11))


def test_near_surface_hides_those_behind() -> None:
    plate = {
        "name": "plate",
        "shape": {"kind": "box", "size_m": [0.01, 0.4, 0.4]},
        "material": "dark",
        "position_m": [0.3, 0.0, 0.0],
    }

    def ahead(**lidar: Any) -> int:
        (cloud,) = rooms.clouds(rooms.scenario(**lidar), rooms.at_rest, 41)
        points = rooms.points(cloud)
        return int(np.sum((points[:, 0] > 0) & (np.abs(points[:, 1]) < 0.5 * points[:, 0])))

    bare = ahead()
    assert ahead(visuals=[plate]) == bare
    assert ahead(visuals=[plate], min_range_m=0.5) == 0


def test_what_is_too_far_is_left_out() -> None:
    (near,) = rooms.clouds(rooms.scenario(max_range_m=4.0), rooms.at_rest, 41)
    (all_of_them,) = rooms.clouds(rooms.scenario(), rooms.at_rest, 41)
    ranges = np.linalg.norm(rooms.points(all_of_them), axis=1)
    assert 0 < len(near.records()) < len(all_of_them.records())
    expected = all_of_them.records()[ranges <= 4.0]
    np.testing.assert_array_equal(near.records(), expected)


def test_a_mount_is_base_from_sensor() -> None:
    """A sensor that looks back sees the same as one that looks ahead from a turned vehicle."""
    turned = {"rpy_deg": [0.0, 0.0, 180.0], "xyz_m": [0.5, 0.0, 0.4]}
    (cloud,) = rooms.clouds(rooms.scenario(mount=turned), rooms.at_rest, 41)

    def other(t: float) -> tuple[Any, Any]:
        position, rpy = rooms.at_rest(t)
        ahead = matrix_from_quaternion(quaternion_from_rpy(*rpy)) @ [0.5, 0.0, 0.0]
        return position + ahead, (0.0, 0.0, rpy[2] + np.pi)

    (same,) = rooms.clouds(rooms.scenario(mount=ABOVE), other, 41)
    np.testing.assert_allclose(rooms.points(cloud), rooms.points(same), atol=1e-5)
