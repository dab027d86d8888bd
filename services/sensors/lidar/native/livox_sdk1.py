# SPDX-License-Identifier: Apache-2.0
"""Packet output of a Livox Avia, by the protocol of Livox SDK 1.

A packet has 16 firings of six lines, or eight with two returns. Packets are not cut where a message
ends.
"""

import numpy as np

from groundlink.messages.base import PointCloud
from services.sensors.lidar.spec import Lidar
from services.sensors.runtime.model import Datagram

from . import livox_sdk1_packets as packets
from .packet_stream import PacketStream, require

POINTS_PER_S = 240_000


class LivoxAvia:
    """Packet output of a LiDAR (a `NativeLidar`).

    Parameters
    ----------
    spec : Lidar
    formats : pair of DataType
        Formats of points with one return and with two.

    Raises
    ------
    UserError
        when the packet format can't represent this LiDAR.
    """

    calibration = ""
    """None: packets have coordinates."""

    def __init__(
        self, spec: Lidar, formats: tuple[packets.DataType, packets.DataType] = packets.CARTESIAN
    ) -> None:
        require(spec, "an Avia", "avia.yaml", _conditions(spec))
        self._kind = formats[spec.returns_per_ray - 1]
        self._size = self._kind.rays // packets.LINES
        encode = packets.ENCODERS[formats[0].point]
        self._stream = PacketStream(spec, self._size, np.arange(packets.LINES), encode)

    def datagrams(self, cloud: PointCloud, epoch_nanos: int) -> list[Datagram]:
        """Return the packets that a cloud completes."""
        numbers, _, measured, start_nanos = self._stream.take(cloud, epoch_nanos)
        nanos = self._stream.schedule.nanos
        stamps_nanos = [start_nanos + nanos(number * self._size) for number in numbers]
        rays = packets.of_rays(measured, self._kind.point)
        return [Datagram(one) for one in packets.point_packets(rays, self._kind, stamps_nanos)]


def _conditions(spec: Lidar) -> dict[str, bool]:
    """Return the conditions for being compatible with Livox' driver."""
    interval_us = 1e6 / POINTS_PER_S
    times_us = np.arange(packets.LINES) * interval_us
    late_us = np.array(spec.laser_times_us)
    return {
        "its lasers are not 6, 4.167 us apart in order (`laser_times_us`)": (
            late_us.shape == times_us.shape and bool(np.abs(late_us - times_us).max() < 1e-3)
        ),
        "by `rotation_rate_hz` and `firings_per_revolution` it does not fire 40000 times a "
        "second": spec.rotation_rate_hz * spec.firings_per_revolution
        == POINTS_PER_S / packets.LINES,
        f"its `returns` are `{spec.returns}`, not `strongest` or `dual`": spec.returns != "last",
    }
