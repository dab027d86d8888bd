# SPDX-License-Identifier: Apache-2.0
"""A planar scanner in a room of known size: ranges, angles, times, errors, and its bits."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import stats

from groundlink.ros.cdr import to_cdr
from groundlink.ros.message_sizes import body_bytes, fitting_block_deg
from groundlink.ros.types import STORE
from groundlink.scenario.ros_side import GatewaySettings
from services.sensors.lidar_2d.spec import Lidar2d
from tests.services.sensors.lidar import rooms

from . import planes

HOKUYO = {
    "rotation_rate_hz": 40.0,
    "firings_per_revolution": 1440,
    "field_of_view_deg": 270.0,
    "start_deg": -135.0,
    "rotation": "counterclockwise",
}
NOISY = {"range_stddev_m": 0.03, "laser_bias_m": 0.02, "range_resolution_m": 0.001, "dropout": 0.1}
DRIVING = rooms.driving(speed_mps=2.0, turn_radps=1.5)


@pytest.mark.parametrize("way", [rooms.at_rest, DRIVING], ids=["at rest", "driving"])
@pytest.mark.parametrize(
    "scanner",
    [{}, HOKUYO, {"rotation": "counterclockwise", "start_deg": 90.0}, {"start_deg": 180.0}],
)
def test_an_ideal_one_reads_the_distance_of_the_walls(way: rooms.Way, scanner: Any) -> None:
    for scan in planes.scans(planes.scenario(**scanner), way, ticks=82):
        # The room's own vehicle is out of the way, so every ray ends on a wall.
        np.testing.assert_allclose(planes.ranges(scan), planes.exact_ranges(scan, way), atol=1e-4)


def test_a_moving_scan_lies_on_the_walls_when_each_ray_has_its_own_pose() -> None:
    (scan,) = planes.scans(planes.scenario(), DRIVING)
    own = planes.points_in_world(scan, DRIVING, planes.seconds(scan))
    assert rooms.off_the_walls(own).max() < 5e-4
    stamped = np.full(len(own), planes.seconds(scan)[0])
    at_the_stamp = planes.points_in_world(scan, DRIVING, stamped)
    assert np.percentile(rooms.off_the_walls(at_the_stamp), 90) > 0.05


def test_angles_and_times_of_a_scan_of_part_of_the_turn() -> None:
    first, second = planes.scans(planes.scenario(**HOKUYO), ticks=21)
    assert len(planes.ranges(first)) == 1081
    assert first.angle_min_rad == pytest.approx(math.radians(-135))
    assert first.angle_increment_rad == pytest.approx(math.radians(0.25))
    assert first.scan_time_s == 0.025
    assert first.time_increment_s == pytest.approx(0.025 / 1440)
    assert first.frame == "rover/scan_link"
    stamps = [scan.stamp_nanos - rooms.EPOCH_NANOS for scan in (first, second)]
    assert stamps == [0, 25_000_000]
    ros = STORE.deserialize_cdr(to_cdr(first), "sensor_msgs/msg/LaserScan")
    assert ros.angle_max == pytest.approx(math.radians(135), abs=1e-4)
    assert len(ros.intensities) == 1081


def test_a_scan_comes_with_the_state_after_its_last_ray() -> None:
    made = planes.scenario(**HOKUYO)
    model = planes.model(made)
    came = [
        (state.tick, scan.stamp_nanos - rooms.EPOCH_NANOS)
        for state in rooms.states(made, rooms.at_rest, 21)
        for scan in model.readings(state)
    ]
    # The last of 1081 rays leaves after 18.75 ms of the turn's 25.
    assert came == [(8, 0), (18, 25_000_000)]


def test_a_clockwise_head_has_a_negative_increment_and_positive_times() -> None:
    (scan,) = planes.scans(planes.scenario(start_deg=180.0))
    assert scan.angle_min_rad == math.pi
    assert scan.angle_increment_rad == pytest.approx(-2 * math.pi / 720)
    assert scan.time_increment_s > 0


def test_intensities_are_reflectivity_times_the_cosine() -> None:
    (scan,) = planes.scans(planes.scenario(mount=planes.Mount((0.0, 0.0, 0.5))))
    intensities = np.frombuffer(scan.intensities, np.float32)
    # Squarely, the walls along x have 0.8 and those along y 0.6; nothing is brighter.
    assert intensities.max() == 80
    assert 60 in intensities
    assert intensities.min() > 0


@pytest.mark.parametrize("beam", [{}, {"divergence_mrad": (2.0, 2.0), "rays_per_beam": 4}])
def test_values_follow_rep_117(beam: dict[str, Any]) -> None:
    (scan,) = planes.scans(planes.scenario(min_range_m=4.0, max_range_m=5.0, **beam))
    exact, measured = planes.exact_ranges(scan, rooms.at_rest), planes.ranges(scan)
    # A beam that has a width meets several distances.
    spread = 0.05 if beam else 1e-4
    near, far = exact < 4.0 - spread, exact > 5.0 + spread
    between = (exact > 4.0 + spread) & (exact < 5.0 - spread)
    for which in (near, far, between):
        assert which.sum() > 20
    assert (measured[near] == -math.inf).all()
    assert (measured[far] == math.inf).all()
    np.testing.assert_allclose(measured[between], exact[between], atol=spread)
    assert (np.frombuffer(scan.intensities, np.float32)[near | far] == 0).all()


def test_what_noise_brings_below_the_least_range_is_near_and_not_free() -> None:
    (exact,) = planes.scans(planes.scenario())
    least = float(np.median(planes.ranges(exact)))
    (scan,) = planes.scans(planes.scenario(min_range_m=least, range_stddev_m=0.05))
    measured = planes.ranges(scan)
    assert ((measured >= least) | (measured == -math.inf)).all()
    assert (measured[planes.ranges(exact) > least + 0.001] == -math.inf).any()


@pytest.mark.parametrize("lost", [{"dropout": 0.1}, {"full_range_reflectivity": 1.0}])
def test_a_lost_echo_is_as_if_nothing_was_there(lost: dict[str, Any]) -> None:
    (scan,) = planes.scans(planes.scenario(max_range_m=8.0, **lost))
    (whole,) = planes.scans(planes.scenario(max_range_m=8.0))
    measured, complete = planes.ranges(scan), planes.ranges(whole)
    gone = measured != complete
    assert (measured[gone] == math.inf).all()
    assert np.isfinite(complete).all()
    if "dropout" in lost:
        assert abs(gone.sum() - 72) < 5 * math.sqrt(720 * 0.1 * 0.9)
    else:
        # Of reflectivity rho, squarely met: seen up to sqrt(rho) of the range; slanted, less far.
        assert 0.05 < gone.mean() < 0.95
        assert (complete[~gone] <= 8.0 * math.sqrt(0.8)).all()


def test_noise_has_the_sheets_sigma() -> None:
    made = planes.scenario(
        range_stddev_m=0.02, range_stddev_share=0.01, firings_per_revolution=7200
    )
    exact = planes.scenario(firings_per_revolution=7200)
    (scan,), (true,) = planes.scans(made), planes.scans(exact)
    sigma = np.hypot(0.02, 0.01 * planes.ranges(true))
    error = (planes.ranges(scan) - planes.ranges(true)) / sigma
    assert abs(np.sum(error**2) - error.size) < 5 * np.sqrt(2 * error.size)
    assert stats.kstest(error, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 5 / np.sqrt(error.size)


def test_a_bias_is_the_same_for_every_ray_and_scan() -> None:
    exact = planes.scans(planes.scenario(), ticks=82)
    biased = planes.scans(planes.scenario(laser_bias_m=0.02), ticks=82)
    errors = [planes.ranges(b) - planes.ranges(e) for b, e in zip(biased, exact, strict=True)]
    assert np.ptp(errors) < 1e-5
    assert 1e-4 < abs(errors[0][0]) <= 0.02


def test_blocks_together_are_the_turn() -> None:
    whole = planes.scans(planes.scenario(**HOKUYO, **NOISY), DRIVING, ticks=41)
    parts = planes.scans(planes.scenario(**HOKUYO, **NOISY, block_deg=90.0), DRIVING, ticks=41)
    assert len(parts) == 3 * len(whole)
    for i, scan in enumerate(whole):
        of_scan = parts[3 * i : 3 * i + 3]
        assert b"".join(part.ranges_m for part in of_scan) == scan.ranges_m
        angles = [planes.directions(part) for part in of_scan]
        np.testing.assert_allclose(np.concatenate(angles), planes.directions(scan), atol=1e-9)
        times = np.concatenate([planes.seconds(part) for part in of_scan])
        np.testing.assert_allclose(times, planes.seconds(scan), atol=2e-9)


@pytest.mark.parametrize("block_deg", [0.0, 90.0])
def test_declared_size_is_the_largest_message(block_deg: float) -> None:
    made = planes.scenario(**HOKUYO, block_deg=block_deg)
    (vehicle,) = made.vehicles
    sizes = {len(to_cdr(scan)) for scan in planes.scans(made)}
    assert max(sizes) == body_bytes(vehicle, vehicle.sensors[0])
    assert vehicle.sensors[0].message_rate_hz == (120.0 if block_deg else 40.0)


def test_a_block_that_fits_is_a_part_of_the_view() -> None:
    (vehicle,) = planes.scenario(**HOKUYO).vehicles
    (spec,) = vehicle.sensors
    assert isinstance(spec, Lidar2d)
    # 120 degrees would fit, too, but 270 cannot be cut into them.
    large = replace(spec, firings_per_revolution=36000)
    assert fitting_block_deg(vehicle, large, GatewaySettings(datagram=420)) == 90


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"elevations_deg": (0.0, 1.0)}, "`elevations_deg` is for LiDARs of kind `lidar`"),
        ({"azimuth_resolution_deg": 0.1}, "`azimuth_resolution_deg` is for LiDARs of kind `lidar`"),
        ({"returns": "dual"}, "`returns` is `dual`, but a scan holds one range a ray"),
        ({"block_deg": 100.0}, "`block_deg` is 100"),
    ],
)
def test_what_is_no_planar_scanners_is_refused(wrong: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Lidar2d(name="scanner", topic="/scan", frame="scan_link", **wrong)
