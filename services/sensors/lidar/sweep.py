# SPDX-License-Identifier: Apache-2.0
"""The sweep of a spinning LiDAR: when and where to each ray of one revolution leaves.

Rule: what depends on the data sheet alone is computed once; a revolution only adds the sensor's
motion. Arrays of rays are (lasers, firings), lasers in the order in which they fire.

The head starts at the sensor's +x axis and turns clockwise seen from above, as the VLP-16 does: the
azimuth grows from x (forward) towards -y (right). It turns on while a firing lasts, so a late
laser's azimuth is larger than that of its firing.
"""

from __future__ import annotations

import numpy as np

from groundlink.clock import TICK_SECONDS
from groundlink.errors import UserError
from groundlink.frames import Floats, matrix_from_quaternion, nlerp, quaternion_from_rpy
from groundlink.scenario.sensors import Lidar, Mount
from services.sensors.rays.scene import Reals


class Sweep:
    """The rays of a data sheet.

    Attributes
    ----------
    rings : uint16 array, shape (lasers,)
        Numbers from below of the lasers, in the order of firing.
    seconds : float64 array, shape (lasers, firings)
        Instant of each ray after the first firing of the revolution.
    directions_in_sensor : float32 array, shape (3, lasers, firings)
        Unit vectors; x forward, y left, z up.
    heights_m : float32 array, shape (lasers, 1)
        Of each laser's origin above the sensor's.
    origins_in_world, directions_in_world : float32 arrays, shape (3, lasers, firings)
        Metres, of the revolution of the last `follow`.
    times : float32 array, shape (lasers, firings)
        0..1 between the first and the last state of the last `follow`.

    Raises
    ------
    UserError
        when the data sheet's lists are not of one length.
    """

    def __init__(self, spec: Lidar) -> None:
        lasers, firings = len(spec.elevations_deg), spec.firings_per_revolution
        late = _per_laser(spec.laser_times_us, lasers, "laser_times_us") * 1e-6
        order = np.argsort(late, kind="stable")
        self.rings = order.astype(np.uint16)
        self._late: Reals = late[order, None].astype(np.float32)
        self._firing_seconds = np.arange(firings + 1) / (firings * spec.rotation_rate_hz)
        self.seconds: Floats = self._firing_seconds[:-1] + late[order, None]
        heights = _per_laser(spec.vertical_offsets_m, lasers, "vertical_offsets_m")
        self.heights_m: Reals = heights[order, None].astype(np.float32)
        elevation = np.radians(spec.elevations_deg)[order, None]
        azimuth = 2 * np.pi * spec.rotation_rate_hz * self.seconds
        self.directions_in_sensor: Reals = np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                -np.cos(elevation) * np.sin(azimuth),
                np.broadcast_to(np.sin(elevation), azimuth.shape),
            ]
        ).astype(np.float32)
        self.origins_in_world: Reals = np.empty_like(self.directions_in_sensor)
        self.directions_in_world: Reals = np.empty_like(self.directions_in_sensor)
        self.times: Reals = np.empty_like(self.directions_in_sensor[0])
        self._axes = np.empty_like(self.directions_in_sensor)
        self._position_in_base = np.array(spec.mount.xyz_m)
        self._base_from_sensor = _rotation(spec.mount)

    def follow(self, world_from_base: Floats, start_seconds: float) -> None:
        """Let each ray of a revolution leave from the sensor's pose at its own instant.

        Between two states the base's position is interpolated linearly and its orientation by
        nlerp, at every firing; between two firings (some 0.05 ms) everything is linear. The last
        lasers of the last firing may leave a few microseconds after the last state (7 with the
        paper's data sheet): the motion of the last interval is extended to them.

        The rays are written where those of the revolution before were: fresh megabytes for each
        would cost more than computing what is in them.

        Parameters
        ----------
        world_from_base : float64 array, shape (states, 7)
            States of consecutive ticks, at least two.
        start_seconds : float
            From the first state to the first firing.
        """
        intervals = len(world_from_base) - 1
        ticks = (start_seconds + self._firing_seconds) / TICK_SECONDS
        before = np.minimum(ticks.astype(np.intp), intervals - 1)
        fraction = ticks - before
        first, second = world_from_base[before], world_from_base[before + 1]
        rotation = matrix_from_quaternion(nlerp(first[:, 3:], second[:, 3:], fraction))
        position = first[:, :3] + fraction[:, None] * (second[:, :3] - first[:, :3])
        position += rotation @ self._position_in_base
        rotation = rotation @ self._base_from_sensor

        for i in range(3):
            # Component by component, so that every operation runs along contiguous firings.
            for j in range(3):
                self._at_lasers(rotation[:, i, j], out=self._axes[j])
            np.einsum(
                "jlf,jlf->lf",
                self._axes,
                self.directions_in_sensor,
                out=self.directions_in_world[i],
            )
            self._at_lasers(position[:, i], out=self.origins_in_world[i])
            self._axes[2] *= self.heights_m
            self.origins_in_world[i] += self._axes[2]

        span = intervals * TICK_SECONDS
        self._at_lasers((start_seconds + self._firing_seconds) / span, out=self.times)
        np.clip(self.times, 0, 1, out=self.times)

    def _at_lasers(self, at_firings: Floats, *, out: Reals) -> None:
        """Write, for each ray's instant, a value known at each firing and at the next one's.

        Parameters
        ----------
        at_firings : float64 array, shape (firings + 1,)
        out : float32 array, shape (lasers, firings)
        """
        rate = np.diff(at_firings) / self._firing_seconds[1]
        np.multiply(self._late, rate.astype(np.float32), out=out)
        out += at_firings[:-1].astype(np.float32)


def _per_laser(values: tuple[float, ...], lasers: int, field: str) -> Floats:
    if values and len(values) != lasers:
        raise UserError(
            f"a LiDAR's `{field}` has {len(values)} values, but its `elevations_deg` has {lasers}; "
            "give one for each laser, or none at all"
        )
    return np.array(values or (0.0,) * lasers)


def _rotation(mount: Mount) -> Floats:
    return matrix_from_quaternion(quaternion_from_rpy(*np.radians(mount.rpy_deg)))
