# SPDX-License-Identifier: Apache-2.0
"""Point cloud packets of Livox LiDARs of SDK 1, such as the Avia: one or two returns of a ray.

The functions convert arrays to bytes. They open no sockets and do not group points into packets.
Source: `livox_def.h` of Livox-SDK (structures, types, status code), `lds.h` and `lds.cpp` of
livox_ros_driver (points of a packet, order of lines and returns). Packets of points have no
checksum in SDK 1. The driver takes the line of a point from its place in the packet, and its
instant from the packet's stamp and the device's interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.sensors.rays.scene import Reals

from .livox_packets import SPOT, spots

LINES = 6

_VERSION, _SLOT, _LIDAR = 5, 7, 1
"""Version of the protocol, as openpylivox expects it; place of a LiDAR without a hub, our own
assumption: Livox-SDK reads it for hubs only."""

_PTP = 1
_STATUS = 1 << 13 | _PTP << 14
"""Everything is in order; signal of PTP present, and synchronized to it."""

_SECOND_RETURN = 1 << 4
"""Bits 4 and 5 of a tag are the number of the return, as commonly quoted of the manual."""

_HEADER = np.dtype(
    [
        ("version", "u1"),
        ("slot", "u1"),
        ("id", "u1"),
        ("reserved", "u1"),
        ("err_code", "<u4"),
        ("timestamp_type", "u1"),
        ("data_type", "u1"),
        ("timestamp", "<u8"),
    ]
)

_DEPTH = np.dtype([("depth_mm", "<u4"), ("reflectivity", "u1"), ("tag", "u1")])
_ANGLES = [("theta", "<u2"), ("phi", "<u2")]
POLAR = np.dtype([("depth_mm", "<u4"), *_ANGLES, ("reflectivity", "u1"), ("tag", "u1")])
"""A point in spherical coordinates: angle from z and azimuth, in hundredths of a degree."""

_TWO_POLAR = np.dtype([*_ANGLES, ("first", _DEPTH), ("second", _DEPTH)])

Spots = NDArray[np.void]


@dataclass(frozen=True)
class DataType:
    """A format of points."""

    number: int
    """`data_type` of a packet."""

    point: np.dtype[np.void]
    """What a packet has of a ray."""

    rays: int
    """Rays of a packet."""


CARTESIAN = (DataType(2, SPOT, 96), DataType(4, np.dtype([("first", SPOT), ("second", SPOT)]), 48))
SPHERICAL = (DataType(3, POLAR, 96), DataType(5, _TWO_POLAR, 48))
"""Formats of one return and of two."""


def polar(points: NDArray[np.void], range_m: Reals) -> Spots:
    """Convert points (`POINT` records) and their ranges, of the same shape, to `POLAR` records."""
    found = np.zeros(points.shape, POLAR)
    x, y, z = (points[axis].astype(np.float64) for axis in "xyz")
    found["depth_mm"] = np.rint(range_m.astype(np.float64) * 1000).clip(0, 2**32 - 1)
    found["theta"] = np.rint(100 * np.degrees(np.arctan2(np.hypot(x, y), z)))
    found["phi"] = np.rint(100 * np.degrees(np.arctan2(y, x))) % 36000
    found["reflectivity"] = np.rint(points["intensity"]).clip(0, 255)
    return found


ENCODERS = {SPOT: spots, POLAR: polar}
"""Converters of points by the format of one return."""


def of_rays(echoes: Spots, point: np.dtype[np.void]) -> Spots:
    """Return what a packet has of each ray.

    Parameters
    ----------
    echoes : SPOT or POLAR array, shape (firings, returns, lines)
        With two returns, both are the same where a ray has one; the second is then all zeros.
    point : dtype
        Format of a ray.

    Returns
    -------
    array of shape (firings * lines,)
    """
    if echoes.shape[1] == 1:
        return echoes.reshape(-1)
    first, second = (np.ascontiguousarray(echoes[:, which]).reshape(-1) for which in (0, 1))
    rays = np.zeros(first.shape, point)
    second = np.where(second != first, second, np.zeros((), second.dtype))
    second["tag"][second != np.zeros((), second.dtype)] |= _SECOND_RETURN
    if first.dtype == SPOT:
        rays["first"], rays["second"] = first, second
        return rays
    for angle, _ in _ANGLES:
        rays[angle] = first[angle]
    for name, returned in (("first", first), ("second", second)):
        for field in _DEPTH.names or ():
            rays[name][field] = returned[field]
    return rays


def point_packets(rays: Spots, kind: DataType, stamps_nanos: Sequence[int]) -> list[bytes]:
    """Return complete packets.

    Parameters
    ----------
    rays : array, a multiple of `kind.rays` long
        Of the type of `kind`, in the order in which they were measured.
    stamps_nanos : sequence with one item per packet
        Instant of each packet's first point, in nanoseconds of a clock synchronized by PTP.
    """
    packet = np.dtype([("header", _HEADER), ("rays", kind.point, kind.rays)])
    packets = np.zeros(len(stamps_nanos), packet)
    header = packets["header"]
    header["version"], header["slot"], header["id"] = _VERSION, _SLOT, _LIDAR
    header["err_code"], header["timestamp_type"] = _STATUS, _PTP
    header["data_type"], header["timestamp"] = kind.number, stamps_nanos
    packets["rays"] = rays.reshape(-1, kind.rays)
    return [one.tobytes() for one in packets]
