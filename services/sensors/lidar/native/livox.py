# SPDX-License-Identifier: Apache-2.0
"""Packet output of a Livox Mid-360.

A packet has 24 firings of four lines. Packets are not cut where a message ends.
"""

import numpy as np

from groundlink.messages.base import PointCloud
from services.sensors.lidar.spec import Lidar
from services.sensors.runtime.model import Datagram

from . import livox_packets as packets
from .packet_stream import PacketStream, require

_SIZE = packets.POINTS // packets.LINES
_FIRING_RATE_HZ = 1e9 / (packets.POINT_NANOS * packets.LINES)


class LivoxMid360:
    """Packet output of a LiDAR (a `NativeLidar`).

    Raises
    ------
    UserError
        when the packet format can't represent this LiDAR.
    """

    calibration = ""
    """None: packets have coordinates."""

    source_port = 56300
    """Livox-SDK2 passes on only what comes from this port."""

    def __init__(self, spec: Lidar) -> None:
        require(spec, "a Mid-360", "mid360.yaml", _conditions(spec))
        self._stream = PacketStream(spec, _SIZE, np.arange(packets.LINES), packets.spots)

    def datagrams(self, cloud: PointCloud, epoch_nanos: int) -> list[Datagram]:
        """Return the packets that a cloud completes."""
        numbers, _, measured, start_nanos = self._stream.take(cloud, epoch_nanos)
        nanos, turn = self._stream.schedule.nanos, self._stream.turn
        firsts = np.arange(numbers.start, numbers.stop) * _SIZE
        # The first packet that begins in a frame has number 0.
        in_frame = firsts // _SIZE - -(-(firsts // turn * turn) // _SIZE)
        stamps_nanos = [start_nanos + nanos(first) for first in firsts.tolist()]
        made = packets.point_packets(measured.ravel(), stamps_nanos, in_frame)
        return [Datagram(packet) for packet in made]


def _conditions(spec: Lidar) -> dict[str, bool]:
    """Return the conditions for being compatible with Livox' driver."""
    times_us = tuple(laser * packets.POINT_NANOS / 1000 for laser in range(packets.LINES))
    return {
        "its lasers are not 4, 5 us apart in order (`laser_times_us`)": (
            spec.laser_times_us == times_us
        ),
        "by `rotation_rate_hz` and `firings_per_revolution` it does not fire 50000 times a "
        "second": (spec.rotation_rate_hz * spec.firings_per_revolution == _FIRING_RATE_HZ),
        f"its `returns` are `{spec.returns}`, not `strongest`": spec.returns == "strongest",
    }
