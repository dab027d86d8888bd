# SPDX-License-Identifier: Apache-2.0
"""Division of published clouds into packets of consecutive firings.

Packets are built from published clouds, so both formats agree even after a fault has changed a
cloud. They form one stream, independent of the division into clouds. Packet i holds the firings
from i times its size on, counted from the run's start, and is complete with the cloud that has its
last firing. A packet with missing firings is never complete.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS, Schedule
from groundlink.core.errors import UserError
from groundlink.messages.base import POINT, PointCloud, measured_nanos
from services.sensors.lidar.spec import Lidar
from services.sensors.rays.scene import Reals
from services.sensors.scanning.sweep import SIGNS

Echoes = NDArray[np.void]
Encode = Callable[[NDArray[np.void], Reals], Echoes]


class Packets(NamedTuple):
    """Complete packets."""

    numbers: range
    """Packets since the run's start."""

    first_firing: int
    """First firing of the first packet, counted from the run's start."""

    echoes: Echoes
    """Shape (firings, returns, channels). With two returns: the last, then the strongest, or the
    second strongest if the strongest is the last. With a single echo both are the same."""

    start_nanos: int
    """UTC of the run's start by the clock of the device, in nanoseconds since 1970."""


class PacketStream:
    """The packets of one LiDAR.

    Attributes
    ----------
    turn : int
        Firings of a revolution.
    schedule : Schedule
        Firings, counted from the run's start.

    Parameters
    ----------
    size : int
        Firings of a packet.
    channels : integer array
        Place of each ring's echo in a firing.
    encode : callable
        Converts points (`POINT` records) and their ranges in meters to echoes. All zeros is no
        return.
    """

    def __init__(
        self, spec: Lidar, size: int, channels: NDArray[np.integer], encode: Encode
    ) -> None:
        lasers = len(channels)
        self._size, self._channels, self._encode = size, channels, encode
        self._returns = spec.returns_per_ray
        self._heights_m = np.array(spec.vertical_offsets_m or [0.0] * lasers, np.float32)
        self._late_s = np.array(spec.laser_times_us or [0.0] * lasers) * 1e-6
        self._blocks = spec.blocks_per_revolution
        self.turn = spec.firings_per_revolution
        self.schedule = Schedule(Schedule.at(spec.rotation_rate_hz).rate_hz * self.turn)
        self._end = -1
        """Index after the last waiting firing."""

        nothing = encode(np.zeros(0, POINT), np.zeros(0, np.float32))
        self._waiting = np.zeros((0, self._returns, lasers), nothing.dtype)

    def take(self, cloud: PointCloud, epoch_nanos: int) -> Packets:
        """Return the packets that a cloud completes."""
        begin = self._first_firing(cloud, epoch_nanos)
        echoes = self._echoes(cloud, begin)
        start_nanos = cloud.stamp_nanos - self.schedule.nanos(begin)
        end = begin + len(echoes)
        if begin == self._end:
            begin -= len(self._waiting)
            echoes = np.concatenate([self._waiting, echoes])
        numbers = range(-(-begin // self._size), end // self._size)
        first, after = numbers.start * self._size, numbers.stop * self._size
        self._end, self._waiting = end, echoes[max(after - begin, 0) :]
        return Packets(numbers, first, echoes[first - begin : after - begin], start_nanos)

    def _first_firing(self, cloud: PointCloud, epoch_nanos: int) -> int:
        """Return the index of a cloud's first firing, whether or not it had a return."""
        sim_nanos = measured_nanos(cloud) - epoch_nanos
        return round(sim_nanos * self.schedule.rate_hz / NANOS)

    def _echoes(self, cloud: PointCloud, first: int) -> Echoes:
        """Return the echoes of a cloud's firings, shape (firings, returns, channels)."""
        index = first % self.turn
        block = -(-index * self._blocks // self.turn)
        firings = (block + 1) * self.turn // self._blocks - index
        points = cloud.records()
        ring = points["ring"]
        firing = np.rint((points["time"] - self._late_s[ring]) * float(self.schedule.rate_hz))
        height = points["z"] - self._heights_m[ring]
        range_m = np.sqrt(points["x"] ** 2 + points["y"] ** 2 + height**2)
        found = self._encode(points, range_m)
        ray = firing.astype(np.intp) * len(self._channels) + self._channels[ring]
        # The second return of a ray follows the first. A single return fills both positions.
        is_second = np.diff(ray, prepend=-1) == 0
        echoes = np.zeros((firings * len(self._channels), self._returns), found.dtype)
        echoes[ray[~is_second]] = found[~is_second, None]
        echoes[ray[is_second], -1] = found[is_second]
        return echoes.reshape(firings, len(self._channels), -1).swapaxes(1, 2)


class TurningStream(PacketStream):
    """The packets of a LiDAR whose head turns all round."""

    def __init__(
        self, spec: Lidar, size: int, channels: NDArray[np.integer], encode: Encode
    ) -> None:
        super().__init__(spec, size, channels, encode)
        self._sign = SIGNS[spec.rotation]
        ahead_deg = np.array(spec.azimuth_offsets_deg or [0.0] * len(channels))
        self._ahead_rad = np.radians(ahead_deg + self._sign * spec.start_deg)

    def _first_firing(self, cloud: PointCloud, epoch_nanos: int) -> int:
        """Return the index of a cloud's first firing, whether or not it had a return.

        The index follows from the stamp, which also determines the azimuth. A stuck device repeats
        old points, whose azimuth contradicts the stamp. In that case the index is that of the
        nearest firing with the points' azimuth.
        """
        first = super()._first_firing(cloud, epoch_nanos)
        for point in cloud.records()[:1]:
            turned_rad = self._sign * math.atan2(point["y"], point["x"])
            turned = (turned_rad - self._ahead_rad[point["ring"]]) / math.tau * self.turn
            before = float(point["time"] * self.schedule.rate_hz)
            first += round(math.remainder(turned - before - first, self.turn))
        return first


def require(spec: Lidar, device: str, sheet: str, conditions: Mapping[str, bool]) -> None:
    """Refuse a LiDAR that a device's packets can't represent.

    Parameters
    ----------
    device, sheet : str
        Name of the device, and of a data sheet of it.
    conditions : mapping
        Whether each condition holds, by the text that says how it is violated.

    Raises
    ------
    UserError
        with the first violated condition.
    """
    for wrong, is_kept in conditions.items():
        if not is_kept:
            raise UserError(
                f"`{spec.name}` has no native packets: not {device}: {wrong}. Fix: leave out "
                f"`native`, or use the data sheet {sheet}"
            )
