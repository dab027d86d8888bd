# SPDX-License-Identifier: Apache-2.0
"""The shipped LiDAR data sheets say what the manual and the paper say."""

import numpy as np
import pytest
from msgspec.structs import replace

from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.sweep import Sweep
from tests.services.sensors.sheets import from_sheet

# VLP-16 User Manual 63-9243 Rev D, table 9-1, by laser id, which is the order of firing.
ELEVATION_DEG = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]
OFFSET_MM = [11.2, -0.7, 9.7, -2.2, 8.1, -3.7, 6.6, -5.1]
OFFSET_MM += [-offset for offset in reversed(OFFSET_MM)]
LASER_US, CYCLE_US = 2.304, 55.296


@pytest.mark.parametrize("name", ["vlp16", "vlp16_paper"])
def test_lasers_fire_in_the_order_of_their_ids(name: str) -> None:
    spec = from_sheet(Lidar, name)
    sweep = Sweep(spec)
    np.testing.assert_allclose(np.array(spec.elevations_deg)[sweep.rings], ELEVATION_DEG)
    np.testing.assert_allclose(sweep.seconds[:, 0], LASER_US * 1e-6 * np.arange(16))
    assert spec.elevations_deg == tuple(sorted(spec.elevations_deg))
    assert (spec.min_range_m, spec.max_range_m) == (0.5, 100.0)


def test_the_makers() -> None:
    spec = from_sheet(Lidar, "vlp16")
    np.testing.assert_allclose(1e3 * Sweep(spec).heights_m, OFFSET_MM, rtol=1e-6)
    cycle_us = 1e6 / (spec.rotation_rate_hz * spec.firings_per_revolution)
    assert cycle_us == pytest.approx(CYCLE_US, rel=3e-4)
    assert spec.firings_per_revolution == int(1e5 / CYCLE_US)
    assert spec.range_resolution_m == 0.002
    assert (spec.range_stddev_m, spec.laser_bias_m) == (0.01, 0.02)


def test_the_papers() -> None:
    spec = from_sheet(Lidar, "vlp16_paper")
    assert len(spec.elevations_deg) * spec.firings_per_revolution == 57_600
    assert 360 / spec.firings_per_revolution == 0.1
    assert set(np.diff(spec.elevations_deg)) == {2.0}
    assert (spec.block_deg, spec.message_rate_hz) == (15.0, 240.0)
    assert (spec.range_stddev_m, spec.laser_bias_m) == (0.03, 0.0)
    assert (spec.vertical_offsets_m, spec.range_resolution_m) == ((), 0.0)


# VLP-32C User Manual 63-9325, tables 9-5 and 9-6, by laser id; two ids fire at a time.
VLP32C_ELEVATION_DEG = [
    *(-25.0, -1.0, -1.667, -15.639, -11.31, 0.0, -0.667, -8.843, -7.254, 0.333, -0.333),
    *(-6.148, -5.333, 1.333, 0.667, -4.0, -4.667, 1.667, 1.0, -3.667, -3.333, 3.333, 2.333),
    *(-2.667, -3.0, 7.0, 4.667, -2.333, -2.0, 15.0, 10.333, -1.333),
]
# The manual's four columns, by laser id as the ROS driver's calibration has them, whose corrections
# are taken off the azimuth, so with the other sign.
VLP32C_AZIMUTH_DEG = [
    *(1.4, -4.2, 1.4, -1.4, 1.4, -1.4, 4.2, -1.4, 1.4, -4.2, 1.4, -1.4, 4.2, -1.4, 4.2, -1.4),
    *(1.4, -4.2, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4, 1.4, -1.4, 1.4, -4.2, 4.2, -1.4, 1.4, -1.4),
]


def test_the_vlp_32c() -> None:
    spec = from_sheet(Lidar, "vlp32c")
    rings = np.argsort(np.argsort(VLP32C_ELEVATION_DEG))  # by laser id
    assert spec.elevations_deg == tuple(sorted(VLP32C_ELEVATION_DEG))
    assert [spec.azimuth_offsets_deg[ring] for ring in rings] == VLP32C_AZIMUTH_DEG
    times_us = [spec.laser_times_us[ring] for ring in rings]
    np.testing.assert_allclose(times_us, np.repeat(LASER_US * np.arange(16), 2))
    assert spec.firings_per_revolution == int(1e5 / CYCLE_US)
    assert spec.range_resolution_m == 0.004
    # It turns clockwise: the first laser is 1.4 degrees to the right, the second 4.2 to the left.
    sweep = Sweep(spec)
    x, y, _ = sweep.directions_in_sensor[:, :, 0]
    azimuth_deg = dict(zip(sweep.rings.tolist(), np.degrees(np.arctan2(y, x)), strict=True))
    assert azimuth_deg[rings[0]] == pytest.approx(-1.4, abs=1e-3)
    assert azimuth_deg[rings[1]] == pytest.approx(4.2, abs=1e-3)


def test_the_avia() -> None:
    spec = from_sheet(Lidar, "avia")
    points_per_s = 6 * spec.firings_per_revolution * spec.rotation_rate_hz
    assert (len(spec.elevations_deg), points_per_s) == (6, 240_000)
    np.testing.assert_allclose(spec.laser_times_us, np.arange(6) * 1e6 / 240_000, atol=1e-6)
    assert (spec.max_range_m, spec.full_range_reflectivity) == (450.0, 0.8)
    width_deg, height_deg = np.degrees(np.array(spec.divergence_mrad) * 1e-3)
    assert (width_deg, height_deg) == pytest.approx((0.03, 0.28), rel=0.01)
    both = np.hypot(spec.azimuth_stddev_deg, spec.elevation_stddev_deg)
    assert both == pytest.approx(0.05, abs=1e-3)


def test_the_xt32() -> None:
    spec = from_sheet(Lidar, "xt32")
    assert spec.elevations_deg == tuple(range(-16, 16))
    np.testing.assert_allclose(spec.laser_times_us, 1.512 * np.arange(31, -1, -1))
    assert (spec.firings_per_revolution, spec.range_resolution_m) == (2000, 0.004)
    # Channel 1 is the highest, fires first, and looks to the left.
    sweep = Sweep(spec)
    assert sweep.rings[0] == 31
    np.testing.assert_allclose(
        sweep.directions_in_sensor[:2, 0, 0], [0, np.cos(np.radians(15))], atol=1e-6
    )


# The first generation's nominal angles: 33.2 degrees in even steps, four columns; 1024 a turn.
OUSTER_AZIMUTH_DEG = [3.164, 1.055, -1.055, -3.164]


def test_the_os1_64() -> None:
    spec = from_sheet(Lidar, "os1_64")
    lasers = 64
    assert (len(spec.elevations_deg), spec.firings_per_revolution) == (lasers, 1024)
    even = np.linspace(-16.611, 16.611, lasers)
    np.testing.assert_allclose(spec.elevations_deg, even, atol=1e-3)
    assert list(spec.azimuth_offsets_deg)[::-1] == OUSTER_AZIMUTH_DEG * 16
    assert (spec.min_range_m, spec.max_range_m, spec.range_stddev_m) == (0.8, 120.0, 0.015)
    # 40 m on a target of 10 %.
    reach_m = spec.max_range_m * np.sqrt(0.1 / spec.full_range_reflectivity)
    assert reach_m == pytest.approx(40.0, rel=0.1)
    # The first column looks back, and the highest beam is ahead of it, clockwise.
    x, y, _ = Sweep(spec).directions_in_sensor[:, -1, 0]
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(180 - 3.164, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "lasers", "view_deg", "returns_m", "step_m"),
    [
        ("vls128", 128, (-25.0, 15.0), (0.3, 300.0), 0.004),
        ("pandar64", 64, (-24.879, 14.9), (0.3, 200.0), 0.004),
        ("pandar_qt64", 64, (-52.121, 52.133), (0.1, 60.0), 0.004),
        ("os1_128", 128, (-21.82, 20.95), (0.5, 120.0), 0.001),
    ],
)
def test_those_with_angles_of_a_calibration(
    name: str,
    lasers: int,
    view_deg: tuple[float, float],
    returns_m: tuple[float, float],
    step_m: float,
) -> None:
    spec = from_sheet(Lidar, name)
    assert len(spec.elevations_deg) == len(spec.azimuth_offsets_deg) == lasers
    assert (spec.elevations_deg[0], spec.elevations_deg[-1]) == view_deg
    assert spec.elevations_deg == tuple(sorted(spec.elevations_deg))
    assert (spec.min_range_m, spec.max_range_m) == returns_m
    assert spec.range_resolution_m == step_m


FITTED = ("vlp16", "vlp32c", "vls128", "xt32", "pandar64", "pandar_qt64", "os1_128")


@pytest.mark.parametrize("name", FITTED)
def test_fitted_ones_differ_in_noise_alone(name: str) -> None:
    base, fitted = from_sheet(Lidar, name), from_sheet(Lidar, f"{name}_fitted")
    assert fitted.echo_bands is not None
    assert base.echo_bands is None
    assert (fitted.range_stddev_m, fitted.dropout) == (0, 0)
    step = fitted.range_resolution_m
    same = {name: getattr(base, name) for name in ("echo_bands", "range_stddev_m", "datasheet")}
    assert replace(fitted, **same, range_resolution_m=base.range_resolution_m) == base
    assert step == (0.008 if name == "os1_128" else base.range_resolution_m)
