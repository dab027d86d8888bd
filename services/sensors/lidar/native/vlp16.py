# SPDX-License-Identifier: Apache-2.0
"""Packet output of a VLP-16.

A data packet has 24 firings, or 12 with two returns. A position packet follows every 14th data
packet, as on the device.
"""

import math
from collections.abc import Sequence

import numpy as np

from groundlink.messages.base import PointCloud
from services.sensors.lidar.spec import Lidar
from services.sensors.rays.scene import Reals
from services.sensors.runtime.model import Datagram
from services.sensors.scanning.sweep import ahead_by_encoder_deg

from . import vlp16_packets as packets
from .packet_stream import TurningStream, require

DATA_PER_POSITION = 14

CYCLE_TOLERANCE = 1e-3
"""Relative tolerance of the firing cycle. It amounts to 1.3 us within a packet."""

RETURN_MODES = {"strongest": packets.STRONGEST, "last": packets.LAST, "dual": packets.DUAL}
"""Return mode by the scenario's `returns`."""

LASER_OF_RING = np.argsort(packets.ELEVATIONS_DEG)


class Vlp16:
    """Packet output of a LiDAR (a `NativeDevice`).

    Raises
    ------
    UserError
        when the packet format can't represent this LiDAR.
    """

    calibration = ""
    """None: decoders know the device's angles."""

    def __init__(self, spec: Lidar) -> None:
        require(spec, "a VLP-16", "vlp16.yaml", _conditions(spec))
        self._mode = RETURN_MODES[spec.returns]
        self._size = packets.BLOCKS * packets.FIRINGS_PER_BLOCK // spec.returns_per_ray
        self._stream = TurningStream(spec, self._size, LASER_OF_RING, packets.echoes)
        turn = spec.firings_per_revolution
        self._azimuths_deg = np.arange(turn) * (360 / turn) + ahead_by_encoder_deg(spec)

    def datagrams(self, cloud: PointCloud, epoch_nanos: int) -> list[Datagram]:
        """Return the packets that a cloud completes."""
        numbers, first, echoes, start_nanos = self._stream.take(cloud, epoch_nanos)
        nanos = self._stream.schedule.nanos
        firings = np.arange(first, first + len(echoes))
        data = packets.data_packets(
            echoes,
            self._azimuths_deg[firings % self._stream.turn],
            [start_nanos + nanos(number * self._size) for number in numbers],
            self._mode,
        )
        datagrams = []
        for number, packet in zip(numbers, data, strict=True):
            datagrams.append(Datagram(packet))
            if (number + 1) % DATA_PER_POSITION == 0:
                at = start_nanos + nanos((number + 1) * self._size)
                datagrams.append(Datagram(packets.position_packet(at), packets.POSITION_PORT))
        return datagrams


def _conditions(spec: Lidar) -> dict[str, bool]:
    """Return the conditions for being compatible with VLP-16 decoders."""
    cycle_us = 1e6 / (spec.rotation_rate_hz * spec.firings_per_revolution)
    encoder = spec.azimuth_resolution_deg, spec.firings_per_azimuth
    turn = spec.rotation, spec.start_deg % 360, spec.field_of_view_deg
    return {
        "its `elevations_deg` are not -15, -13 .. 15": _are(
            spec.elevations_deg, sorted(packets.ELEVATIONS_DEG), 0.005
        ),
        "by `laser_times_us` its lasers do not fire 2.304 us apart, in the order -15, 1, -13, 3 .. "
        "15 degrees": _are(spec.laser_times_us, LASER_OF_RING * packets.LASER_MICROS, 0.01),
        f"by `rotation_rate_hz` and `firings_per_revolution` a firing takes {cycle_us:.3f} us, not "
        f"{packets.FIRING_MICROS}": math.isclose(
            cycle_us, packets.FIRING_MICROS, rel_tol=CYCLE_TOLERANCE
        ),
        "it does not turn clockwise, all round, from 0 degrees on (`rotation`, `start_deg`, "
        "`field_of_view_deg`)": turn == ("clockwise", 0, 360),
        "it has no `azimuth_resolution_deg` of 0.01 with `firings_per_azimuth: 2`": encoder
        == (packets.AZIMUTH_STEP_DEG, packets.FIRINGS_PER_BLOCK),
        "it has `azimuth_offsets_deg`": not any(spec.azimuth_offsets_deg),
        "it has a `mirror`": spec.mirror is None,
        f"its `max_range_m` is above {packets.MAX_RANGE_M:g}": (
            spec.max_range_m <= packets.MAX_RANGE_M
        ),
    }


def _are(given: Sequence[float], expected: Sequence[float] | Reals, tolerance: float) -> bool:
    return len(given) == len(expected) and np.allclose(given, expected, rtol=0, atol=tolerance)
