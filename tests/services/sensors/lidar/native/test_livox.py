# SPDX-License-Identifier: Apache-2.0
"""Clouds as a Mid-360's packets, decoded as livox_ros_driver2 does: line and time by place."""

import struct
from typing import Any

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.messages.base import PointCloud
from services.sensors.lidar.native.livox import LivoxMid360
from tests.services.sensors.lidar import rooms

from .test_vlp16 import POLES, WAY, sheet, spec

RAW = np.dtype([("mm", "<i4", 3), ("reflectivity", "u1"), ("tag", "u1")])
DECODED = np.dtype([("xyz", "f8", 3), ("reflectivity", "u1"), ("line", "u1"), ("nanos", "i8")])


def sent(fields: dict[str, Any], clouds: list[PointCloud]) -> list[bytes]:
    """Return the payloads that a fresh device makes of clouds."""
    device = LivoxMid360(spec(**fields))
    return [one.payload for cloud in clouds for one in device.datagrams(cloud, rooms.EPOCH_NANOS)]


def decoded(packets: list[bytes]) -> np.ndarray:
    """Return the points of packets that have a return."""
    found = []
    for packet in packets:
        interval, count = struct.unpack_from("<HH", packet, 3)
        (stamp_nanos,) = struct.unpack_from("<Q", packet, 28)
        raw = np.frombuffer(packet, RAW, count, 36)
        points = np.zeros(count, DECODED)
        points["xyz"], points["reflectivity"] = raw["mm"] / 1000, raw["reflectivity"]
        points["line"] = np.arange(count) % 4
        points["nanos"] = stamp_nanos + np.arange(count) * (interval * 100 // count)
        found.append(points[raw["mm"].any(axis=1)])
    return np.concatenate(found)


def test_the_driver_finds_the_points_of_the_clouds() -> None:
    fields = sheet("mid360", min_range_m=0.0)
    clouds = rooms.clouds(rooms.scenario(solids=POLES, **fields), WAY, 121)
    payloads = sent(fields, clouds)
    assert LivoxMid360.source_port == 56300
    # 15,000 firings are 625 packets.
    assert len(payloads) == 625
    found = decoded(payloads)
    ours = np.concatenate([cloud.records() for cloud in clouds])
    seconds = np.concatenate([rooms.sim_seconds(cloud) for cloud in clouds])
    assert len(found) == len(ours) > 40_000
    np.testing.assert_array_equal(found["line"], ours["ring"])
    np.testing.assert_array_equal(found["reflectivity"], np.rint(ours["intensity"]))
    assert np.abs(found["nanos"] - rooms.EPOCH_NANOS - seconds * 1e9).max() < 20
    coordinates = np.stack([ours[axis] for axis in "xyz"], -1).astype(np.float64)
    assert np.abs(found["xyz"] - coordinates).max() < 0.00051
    # 208.3 packets begin in a frame; the first of each has number 0.
    counters = np.array([struct.unpack_from("<H", packet, 7)[0] for packet in payloads])
    assert np.flatnonzero(counters == 0).tolist() == [0, 209, 417]
    assert np.all(np.diff(counters)[np.diff(counters) > 0] == 1)


def test_packets_do_not_depend_on_the_messages() -> None:
    whole = sheet("mid360")
    blocks = whole | {"block_deg": 22.5}
    a, b = (rooms.clouds(rooms.scenario(**fields), WAY, 81) for fields in (whole, blocks))
    assert (len(a), len(b)) == (2, 32)
    assert sent(whole, a) == sent(blocks, b)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"laser_times_us": [0.0, 5.0, 10.0, 16.0]}, "`laser_times_us`"),
        ({"elevations_deg": [0.0] * 3, "laser_times_us": []}, "lasers are not 4"),
        ({"firings_per_revolution": 4000}, "50000 times a second"),
        ({"returns": "last"}, "`last`, not `strongest`"),
    ],
)
def test_specs_without_livox_packets_are_refused(changed: dict[str, Any], reason: str) -> None:
    with pytest.raises(UserError, match="not a Mid-360") as refused:
        LivoxMid360(spec(**sheet("mid360") | changed))
    assert reason in str(refused.value)
    assert "mid360.yaml" in str(refused.value)
