# SPDX-License-Identifier: Apache-2.0
"""Clouds as an Avia's packets, decoded as livox_ros_driver does: line and time by place.

The decoder is written from the structures of Livox-SDK; it shares no code with the encoder.
"""

import math
import struct
from typing import Any, NamedTuple

import numpy as np
import pytest

from groundlink.core.errors import UserError
from groundlink.messages.base import PointCloud
from services.sensors.lidar.native import FORMATS
from tests.services.sensors.lidar import rooms

from .test_vlp16 import POLES, WAY, sheet, spec

RAYS = {2: 96, 3: 96, 4: 48, 5: 48}
BYTES = {2: 14, 3: 10, 4: 28, 5: 16}


class Decoded(NamedTuple):
    """A point that returned."""

    place: tuple[float, float, float]
    reflectivity: int
    tag: int
    line: int
    nanos: float


def sent(fields: dict[str, Any], clouds: list[PointCloud]) -> list[bytes]:
    """Return the payloads that a fresh device makes of clouds."""
    lidar = spec(**fields)
    device = FORMATS[lidar.native_format](lidar)
    return [one.payload for cloud in clouds for one in device.datagrams(cloud, rooms.EPOCH_NANOS)]


def from_angles(depth_mm: int, theta: int, phi: int) -> tuple[float, float, float]:
    """Return meters of millimeters and hundredths of a degree."""
    zenith, azimuth, depth = math.radians(theta / 100), math.radians(phi / 100), depth_mm / 1000
    level = depth * math.sin(zenith)
    return level * math.cos(azimuth), level * math.sin(azimuth), depth * math.cos(zenith)


def returns(kind: int, ray: bytes) -> list[tuple[tuple[float, float, float], int, int]]:
    """Return place, reflectivity and tag of the returns of a ray, also of missing ones."""
    if kind in (2, 4):
        parts = [ray[at : at + 14] for at in range(0, len(ray), 14)]
        fields = [struct.unpack("<iiiBB", part) for part in parts]
        return [((x / 1000, y / 1000, z / 1000), *rest) for x, y, z, *rest in fields]
    if kind == 3:
        depth_mm, theta, phi, reflectivity, tag = struct.unpack("<IHHBB", ray)
        return [(from_angles(depth_mm, theta, phi), reflectivity, tag)]
    theta, phi, *both = struct.unpack("<HHIBBIBB", ray)
    return [(from_angles(both[at], theta, phi), both[at + 1], both[at + 2]) for at in (0, 3)]


def decoded(packets: list[bytes]) -> list[Decoded]:
    """Return the points of packets that have a return, checking all other bytes."""
    found = []
    for packet in packets:
        head = struct.unpack_from("<BBBBIBB", packet)
        kind = head[-1]
        # Version, slot and LiDAR without a hub, PTP present and used, time by PTP.
        assert head == (5, 7, 1, 0, 0x6000, 1, kind)
        assert len(packet) == 18 + RAYS[kind] * BYTES[kind]
        (stamp_nanos,) = struct.unpack_from("<Q", packet, 10)
        for index in range(RAYS[kind]):
            ray = packet[18 + index * BYTES[kind] :][: BYTES[kind]]
            nanos = stamp_nanos - rooms.EPOCH_NANOS + index * 1e9 / 240_000
            for place, reflectivity, tag in returns(kind, ray):
                if any(place):
                    found.append(Decoded(place, reflectivity, tag, index % 6, nanos))
    return found


@pytest.mark.parametrize(
    ("native_format", "mode", "size", "off_m"),
    [
        ("livox_avia", "strongest", 1362, 0.0009),
        ("livox_avia", "dual", 1362, 0.0009),
        # Half of 0.01 degrees is 0.6 mm at 7 m, twice.
        ("livox_avia_spherical", "strongest", 978, 0.0016),
        ("livox_avia_spherical", "dual", 786, 0.0016),
    ],
)
def test_the_driver_finds_the_points_of_the_clouds(
    native_format: str, mode: str, size: int, off_m: float
) -> None:
    # False returns of sunlight are up to 450 m away, where 0.01 degrees are 8 cm.
    fields = sheet("avia", native_format=native_format, returns=mode, rays_per_beam=4, sun=None)
    clouds = rooms.clouds(rooms.scenario(solids=POLES, **fields), WAY, 81)
    payloads = sent(fields, clouds)
    assert {len(payload) for payload in payloads} == {size}
    # 8,000 firings of six rays.
    assert len(payloads) == 48_000 // (48 if mode == "dual" else 96)
    found = decoded(payloads)
    ours = np.concatenate([cloud.records() for cloud in clouds])
    seconds = np.concatenate([rooms.sim_seconds(cloud) for cloud in clouds])
    assert len(found) == len(ours) > 30_000
    places = np.array([point.place for point in found])
    np.testing.assert_array_equal([point.line for point in found], ours["ring"])
    np.testing.assert_array_equal([point.reflectivity for point in found], ours["intensity"])
    assert np.abs(np.array([point.nanos for point in found]) - seconds * 1e9).max() < 20
    coordinates = np.stack([ours[axis] for axis in "xyz"], -1).astype(np.float64)
    assert np.linalg.norm(places - coordinates, axis=1).max() < off_m
    # The second return of a ray has number 1 in its tag.
    is_second = np.diff(np.rint(seconds * 240_000), prepend=-1) == 0
    np.testing.assert_array_equal([point.tag for point in found], np.where(is_second, 16, 0))
    assert is_second.any() == (mode == "dual")


def test_packets_do_not_depend_on_the_messages() -> None:
    whole = sheet("avia")
    blocks = whole | {"block_deg": 22.5}
    a, b = (rooms.clouds(rooms.scenario(**fields), WAY, 81) for fields in (whole, blocks))
    assert (len(a), len(b)) == (2, 32)
    assert sent(whole, a) == sent(blocks, b)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"laser_times_us": [0.0, 4.2, 8.3, 12.5, 16.7, 20.8]}, "`laser_times_us`"),
        ({"elevations_deg": [0.0] * 3, "laser_times_us": []}, "lasers are not 6"),
        ({"firings_per_revolution": 5000}, "40000 times a second"),
        ({"returns": "last"}, "`last`, not `strongest` or `dual`"),
    ],
)
def test_specs_without_avia_packets_are_refused(changed: dict[str, Any], reason: str) -> None:
    fields = sheet("avia") | changed
    with pytest.raises(UserError, match="not an Avia") as refused:
        sent(fields, [])
    assert reason in str(refused.value)
    assert "avia.yaml" in str(refused.value)
