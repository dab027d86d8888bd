# SPDX-License-Identifier: Apache-2.0
"""Conversion of published clouds to the packet stream of a VLP-16.

Packets are built from published clouds, so both formats agree even after a fault has changed a
cloud. The packets form one stream, independent of the division into clouds. Packet i holds the
firings from i times 24 on (12 with two returns), counted from the run's start, and is sent with the
cloud that completes it. A packet with missing firings is not sent. A position packet follows every
14th data packet, as on the device.
"""

import math
from collections.abc import Sequence

import numpy as np

from groundlink.core.clock import NANOS, Schedule
from groundlink.core.errors import UserError
from groundlink.messages.base import PointCloud, measured_nanos
from services.sensors.rays.scene import Reals
from services.sensors.runtime.model import Datagram
from services.sensors.scanning.sweep import ahead_by_encoder_deg

from . import packets
from .spec import Lidar

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

    def __init__(self, spec: Lidar) -> None:
        if wrong := _misfit(spec):
            raise UserError(
                f"`{spec.name}` has no native packets: not a VLP-16: {wrong}. Fix: leave out "
                "`native`, or use the data sheet vlp16.yaml"
            )
        self._mode, self._returns = RETURN_MODES[spec.returns], spec.returns_per_ray
        self._size = packets.BLOCKS * packets.FIRINGS_PER_BLOCK // self._returns
        self._heights_m = np.array(spec.vertical_offsets_m or [0.0] * packets.LASERS, np.float32)
        self._turn = spec.firings_per_revolution
        self._azimuths_deg = np.arange(self._turn) * (360 / self._turn) + ahead_by_encoder_deg(spec)
        self._blocks = spec.blocks_per_revolution
        self._schedule = Schedule(Schedule.at(spec.rotation_rate_hz).rate_hz * self._turn)
        """Schedule of firings, counted from the run's start."""

        self._end = -1
        """Index after the last waiting firing."""

        self._waiting = np.zeros((0, self._returns, packets.LASERS), packets.ECHO)

    def datagrams(self, cloud: PointCloud, epoch_nanos: int) -> list[Datagram]:
        """Return the packets that a cloud completes."""
        begin = self._first_firing(cloud, epoch_nanos)
        measured = self._measured(cloud, begin)
        stamp_nanos = cloud.stamp_nanos - self._schedule.nanos(begin)
        end = begin + len(measured)
        if begin == self._end:
            begin -= len(self._waiting)
            measured = np.concatenate([self._waiting, measured])
        numbers = range(-(-begin // self._size), end // self._size)
        first, after = numbers.start * self._size, numbers.stop * self._size
        self._end, self._waiting = end, measured[max(after - begin, 0) :]
        data = packets.data_packets(
            measured[first - begin : after - begin],
            self._azimuths_deg[np.arange(first, after) % self._turn],
            [stamp_nanos + self._schedule.nanos(number * self._size) for number in numbers],
            self._mode,
        )
        datagrams = []
        for number, packet in zip(numbers, data, strict=True):
            datagrams.append(Datagram(packet))
            if (number + 1) % DATA_PER_POSITION == 0:
                at = stamp_nanos + self._schedule.nanos((number + 1) * self._size)
                datagrams.append(Datagram(packets.position_packet(at), packets.POSITION_PORT))
        return datagrams

    def _first_firing(self, cloud: PointCloud, epoch_nanos: int) -> int:
        """Return the index of a cloud's first firing, whether or not it had a return.

        The index follows from the stamp, which also determines the azimuth. A stuck device repeats
        old points, whose azimuth contradicts the stamp. In that case the index is that of the
        nearest firing with the points' azimuth.
        """
        sim_nanos = measured_nanos(cloud) - epoch_nanos
        first = round(sim_nanos * self._schedule.rate_hz / NANOS)
        for point in cloud.records()[:1]:
            turned = math.atan2(-point["y"], point["x"]) / math.tau * self._turn
            before = float(point["time"] * self._schedule.rate_hz)
            first += round(math.remainder(turned - before - first, self._turn))
        return first

    def _measured(self, cloud: PointCloud, first: int) -> packets.Echoes:
        """Return the measurements of a cloud's firings, shape (firings, returns, 16)."""
        index = first % self._turn
        block = -(-index * self._blocks // self._turn)
        firings = (block + 1) * self._turn // self._blocks - index
        points = cloud.records()
        laser = LASER_OF_RING[points["ring"]]
        seconds = points["time"] - laser * (packets.LASER_MICROS * 1e-6)
        firing = np.rint(seconds * float(self._schedule.rate_hz)).astype(np.intp)
        height = points["z"] - self._heights_m[points["ring"]]
        range_m = np.sqrt(points["x"] ** 2 + points["y"] ** 2 + height**2)
        found = packets.echoes(range_m, points["intensity"])
        ray = firing * packets.LASERS + laser
        # The second return of a ray follows the first. A single return fills both positions.
        is_second = np.diff(ray, prepend=-1) == 0
        measured = np.zeros((firings * packets.LASERS, self._returns), packets.ECHO)
        measured[ray[~is_second]] = found[~is_second, None]
        measured[ray[is_second], -1] = found[is_second]
        return measured.reshape(firings, packets.LASERS, -1).swapaxes(1, 2)


def vlp16_device(model: object, spec: Lidar) -> Vlp16:
    """Return the device that sends VLP-16 packets."""
    return Vlp16(spec)


def _misfit(spec: Lidar) -> str | None:
    """Return why a LiDAR is incompatible with VLP-16 decoders; None if it is compatible."""
    cycle_us = 1e6 / (spec.rotation_rate_hz * spec.firings_per_revolution)
    encoder = spec.azimuth_resolution_deg, spec.firings_per_azimuth
    turn = spec.rotation, spec.start_deg % 360, spec.field_of_view_deg
    conditions = {
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
        f"its `max_range_m` is above {packets.MAX_RANGE_M:g}": (
            spec.max_range_m <= packets.MAX_RANGE_M
        ),
    }
    return next((wrong for wrong, is_kept in conditions.items() if not is_kept), None)


def _are(given: Sequence[float], expected: Sequence[float] | Reals, tolerance: float) -> bool:
    return len(given) == len(expected) and np.allclose(given, expected, rtol=0, atol=tolerance)
