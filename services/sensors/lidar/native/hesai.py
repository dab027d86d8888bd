# SPDX-License-Identifier: Apache-2.0
"""Packet output of a Hesai PandarXT-32, and its angle correction file.

A packet has 8 firings, or 4 with two returns.
"""

import math

import numpy as np

from groundlink.messages.base import PointCloud
from services.sensors.lidar.spec import Lidar
from services.sensors.runtime.model import Datagram

from . import hesai_packets as packets
from .packet_stream import TurningStream, require

RETURN_MODES = {"strongest": packets.STRONGEST, "last": packets.LAST, "dual": packets.DUAL}
"""Return mode by the scenario's `returns`."""

RATES_HZ = (5, 10, 20)

_FROM_THE_HIGHEST = np.arange(packets.LASERS)[::-1]


class HesaiXt32:
    """Packet output of a LiDAR (a `NativeLidar`).

    Raises
    ------
    UserError
        when the packet format can't represent this LiDAR.
    """

    def __init__(self, spec: Lidar) -> None:
        require(spec, "a PandarXT-32", "xt32.yaml", _conditions(spec))
        self._mode, self._rpm = RETURN_MODES[spec.returns], round(60 * spec.rotation_rate_hz)
        self._size = packets.BLOCKS // spec.returns_per_ray
        self._stream = TurningStream(spec, self._size, _FROM_THE_HIGHEST, packets.echoes)
        stamp_micros = (self._size - 1) * packets.FIRING_MICROS
        stamp_micros += packets.STAMP_AFTER_LAST_FIRING_MICROS
        self._stamp_nanos = round(1000 * stamp_micros)
        self.calibration = _angle_correction(spec)

    def datagrams(self, cloud: PointCloud, epoch_nanos: int) -> list[Datagram]:
        """Return the packets that a cloud completes."""
        numbers, first, measured, start_nanos = self._stream.take(cloud, epoch_nanos)
        nanos, turn = self._stream.schedule.nanos, self._stream.turn
        stamps_nanos = [start_nanos + nanos(i * self._size) + self._stamp_nanos for i in numbers]
        azimuths_deg = np.arange(first, first + len(measured)) % turn * (360 / turn)
        made = packets.data_packets(
            measured, azimuths_deg, stamps_nanos, numbers, self._mode, self._rpm
        )
        return [Datagram(packet) for packet in made]


def _angle_correction(spec: Lidar) -> str:
    """Return the angle correction file: angles of each channel, azimuths relative to its block's.

    Decoders add these to a block's azimuth and do not extrapolate the rotation, so an azimuth has
    the rotation from the start of the firing to the channel.
    """
    offsets_deg = np.array(spec.azimuth_offsets_deg or (0.0,) * packets.LASERS)
    offsets_deg += 360e-6 * spec.rotation_rate_hz * np.array(spec.laser_times_us)
    rows = zip(np.array(spec.elevations_deg)[::-1], offsets_deg[::-1], strict=True)
    lines = [f"{i},{up:.6f},{ahead:.6f}" for i, (up, ahead) in enumerate(rows, start=1)]
    return "\n".join(["Channel,Elevation,Azimuth", *lines, ""])


def _conditions(spec: Lidar) -> dict[str, bool]:
    """Return the conditions for being compatible with decoders of the PandarXT-32."""
    lasers = len(spec.elevations_deg)
    cycle_us = 1e6 / (spec.rotation_rate_hz * spec.firings_per_revolution)
    times_us = _FROM_THE_HIGHEST * packets.LASER_MICROS
    turn = spec.rotation, spec.start_deg % 360, spec.field_of_view_deg
    return {
        "its `elevations_deg` are not 32": lasers == packets.LASERS,
        "by `laser_times_us` its lasers do not fire 1.512 us apart, from the highest down": (
            len(spec.laser_times_us) == packets.LASERS
            and np.allclose(spec.laser_times_us, times_us, rtol=0, atol=0.01)
        ),
        "its `rotation_rate_hz` is not 5, 10 or 20": spec.rotation_rate_hz in RATES_HZ,
        f"by `rotation_rate_hz` and `firings_per_revolution` a firing takes {cycle_us:.3f} us, not "
        f"{packets.FIRING_MICROS:g}": math.isclose(cycle_us, packets.FIRING_MICROS),
        "it does not turn clockwise, all round, from 90 degrees on (`rotation`, `start_deg`, "
        "`field_of_view_deg`)": turn == ("clockwise", 90, 360),
        "it has `vertical_offsets_m`": not any(spec.vertical_offsets_m),
        "it has an `azimuth_resolution_deg`": not spec.azimuth_resolution_deg,
        "it has a `mirror`": spec.mirror is None,
        f"its `max_range_m` is above {packets.MAX_RANGE_M:g}": (
            spec.max_range_m <= packets.MAX_RANGE_M
        ),
    }
