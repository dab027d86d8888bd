# SPDX-License-Identifier: Apache-2.0
"""The shipped sheets of planar scanners say what their makers say, and give such scans."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from msgspec.structs import asdict

from services.sensors.lidar_2d.spec import Lidar2d
from tests.services.sensors.lidar import rooms
from tests.services.sensors.sheets import from_sheet

from . import planes


class Device(NamedTuple):
    """What the sheet's source says."""

    beams: int
    first_deg: float
    step_deg: float
    scan_s: float
    ranges_m: tuple[float, float]


DEVICES = {
    # Specification: 270 degrees, 0.25 degrees (360 / 1440), 25 ms, 0.1 to 30 m.
    "utm30lx": Device(1081, -135.0, 0.25, 0.025, (0.1, 30.0)),
    # Operating instructions 8012471: 270 degrees, 0.5 degrees at 50 Hz; 0.5 to 20 m.
    "lms111": Device(541, -135.0, 0.5, 0.02, (0.5, 20.0)),
    # Data sheet A2M8, rev 2.5: 360 degrees, 0.45 degrees at 10 Hz, clockwise; 0.15 to 12 m.
    "rplidar_a2": Device(800, 180.0, -0.45, 0.1, (0.15, 12.0)),
}


def sheet(name: str) -> dict[str, Any]:
    fields = asdict(from_sheet(Lidar2d, name)) | {"mount": planes.MOUNT}
    del fields["seed"]  # `planes.scenario` takes that of the scenario
    return fields


@pytest.mark.parametrize(("name", "device"), DEVICES.items())
def test_a_scan_is_that_of_the_device(name: str, device: Device) -> None:
    scan = planes.scans(planes.scenario(**sheet(name)), ticks=42)[0]
    assert len(planes.ranges(scan)) == device.beams
    assert math.degrees(scan.angle_min_rad) == pytest.approx(device.first_deg)
    assert math.degrees(scan.angle_increment_rad) == pytest.approx(device.step_deg)
    assert scan.scan_time_s == pytest.approx(device.scan_s)
    steps_of_a_turn = 360 / abs(device.step_deg)
    assert scan.time_increment_s == pytest.approx(device.scan_s / steps_of_a_turn)
    assert (scan.min_range_m, scan.max_range_m) == device.ranges_m


@pytest.mark.parametrize("name", DEVICES)
def test_it_sees_the_room_as_well_as_the_sheet_says(name: str) -> None:
    spec = sheet(name)
    scan = planes.scans(planes.scenario(**spec), ticks=42)[0]
    exact, measured = planes.exact_ranges(scan, rooms.at_rest), planes.ranges(scan)
    assert np.isfinite(measured).all()
    sigma = np.hypot(spec["range_stddev_m"], spec["range_stddev_share"] * exact)
    bias_m = spec["laser_bias_m"] + 2 * spec["range_resolution_m"]
    # Beams that have a width meet the walls' corners in more places than one.
    assert np.percentile(np.abs(measured - exact) / (5 * sigma + bias_m), 97) < 1
    assert np.std(measured - exact) > 0.5 * np.median(sigma)


# Sigma at a distance: below 10 mm up to 10 m and below 30 mm up to 30 m; 12 mm; half of 1 %.
SCATTER = [
    ("utm30lx", 10.0, 0.010),
    ("utm30lx", 30.0, 0.030),
    ("lms111", 10.0, 0.012),
    ("rplidar_a2", 10.0, 0.05),
]


@pytest.mark.parametrize(("name", "distance_m", "most_m"), SCATTER)
def test_scatter_is_within_the_sheets(name: str, distance_m: float, most_m: float) -> None:
    spec = sheet(name)
    sigma = math.hypot(spec["range_stddev_m"], spec["range_stddev_share"] * distance_m)
    assert 0.7 * most_m < sigma <= most_m


def test_the_sick_sees_a_dark_target_as_far_as_it_says() -> None:
    spec = sheet("lms111")
    reach_m = spec["max_range_m"] * math.sqrt(0.1 / spec["full_range_reflectivity"])
    assert reach_m == pytest.approx(18.0, abs=0.1)
