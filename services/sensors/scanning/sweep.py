# SPDX-License-Identifier: Apache-2.0
"""Sweep of a rotating head: instant and direction of each ray of one revolution.

All that depends on the data sheet alone is computed once; a revolution adds the sensor's motion.
Arrays of rays are (lasers, firings), lasers in the order in which they fire. The head turns during
a firing, so a later laser is ahead of its firing. An encoder with steps is read at a step: rays
leave where they are reported. Outside a view of less than a whole turn there are no firings.
"""

import ctypes
from ctypes import c_double, c_size_t, c_void_p

import numpy as np

from groundlink.core.clock import TICK_SECONDS
from groundlink.core.frames import Floats, matrix_from_quaternion, quaternion_from_rpy
from groundlink.scenario.rotating_lidar import RotatingLidar
from services.sensors.rays.kernels import kernels
from services.sensors.rays.scene import Reals

SIGNS = {"clockwise": -1, "counterclockwise": 1}
"""Sign of the azimuth's growth, by the spec's `rotation`."""


class Head(ctypes.Structure):
    """The structure `head` of `sweep.c`."""

    _fields_ = (
        ("lasers", c_size_t),
        ("firings", c_size_t),
        ("base_from_sensor", c_double * 9),
        ("position_in_base", c_double * 3),
        ("ticks_per_firing", c_double),
        ("seconds_per_firing", c_double),
        ("late_seconds", c_void_p),
        ("heights", c_void_p),
        ("directions_in_sensor", c_void_p),
    )


class Sweep:
    """The rays of a data sheet.

    Attributes
    ----------
    rings : uint16 array, shape (lasers,)
        Numbers from below of the lasers, in the order of firing.
    seconds : float64 array, shape (lasers, firings)
        Instant of each ray after the first firing of the revolution.
    directions_in_sensor : float32 array, shape (3, lasers, firings)
        Unit vectors of the beams' axes as they are reported; x forward, y left, z up.
    heights_m : float32 array, shape (lasers,)
        Of each laser's origin above the sensor's.
    latest_seconds : float
        From the start of a firing to its last laser.
    origins_in_world, directions_in_world : float32 arrays, shape (3, lasers, firings)
        Meters, of the axes, of the firings of the last `follow`.
    poses : float32 array, shape (2, 12, firings)
        Of the sensor at each firing of the last `follow`: rotation world_from_sensor row by row,
        then its position; then how much these change in a second.
    times : float32 array, shape (lasers, firings)
        0..1 between the first and the last state of the last `follow`.
    head : Head
        Input of the compiled passes.
    """

    def __init__(self, spec: RotatingLidar) -> None:
        lasers, firings = len(spec.elevations_deg), spec.firings_in_view
        late = _per_laser(spec.laser_times_us, lasers) * 1e-6
        order = np.argsort(late, kind="stable")
        self.rings = order.astype(np.uint16)
        self.latest_seconds = float(late.max())
        self._late: Reals = late[order].astype(np.float32)
        seconds_per_firing = 1 / (spec.firings_per_revolution * spec.rotation_rate_hz)
        self.seconds: Floats = np.arange(firings) * seconds_per_firing + late[order, None]
        heights = _per_laser(spec.vertical_offsets_m, lasers)
        self.heights_m: Reals = heights[order].astype(np.float32)
        elevation = np.radians(spec.elevations_deg)[order, None]
        sign = SIGNS[spec.rotation]
        ahead = np.radians(_per_laser(spec.azimuth_offsets_deg, lasers))[order, None]
        ahead += sign * np.radians(spec.start_deg)
        turned = 2 * np.pi * spec.rotation_rate_hz * self.seconds + ahead
        turned += np.radians(ahead_by_encoder_deg(spec))
        azimuth = sign * turned
        self.directions_in_sensor: Reals = unit_vectors(azimuth, elevation).astype(np.float32)
        self.origins_in_world: Reals = np.empty_like(self.directions_in_sensor)
        self.directions_in_world: Reals = np.empty_like(self.directions_in_sensor)
        self.times: Reals = np.empty_like(self.directions_in_sensor[0])
        self._timed: tuple[float, int] | None = None
        self.poses: Reals = np.empty((2, 12, firings), np.float32)
        base_from_sensor = matrix_from_quaternion(
            quaternion_from_rpy(*np.radians(spec.mount.rpy_deg))
        )
        self.head = Head(
            *(lasers, firings),
            *((c_double * 9)(*base_from_sensor.flat), (c_double * 3)(*spec.mount.xyz_m)),
            *(seconds_per_firing / TICK_SECONDS, seconds_per_firing),
            *(self._late.ctypes.data, self.heights_m.ctypes.data),
            self.directions_in_sensor.ctypes.data,
        )

    def aim(self, revolution: int) -> None:
        """Do nothing; the rays of a head have the same directions in every revolution."""

    def follow(self, world_from_base: Floats, start_seconds: float, firings: range) -> None:
        """Compute origins and directions of rays from the sensor's pose at their instants.

        Between two states the base's position is interpolated linearly and its orientation by
        nlerp, at every firing; between two firings (some 0.05 ms) everything is linear. The last
        lasers of the last firing may leave a few microseconds after the last state (7 with the
        paper's data sheet): the motion of the last interval is extended to them.

        A ray does not depend on which other firings are computed, so blocks have the same numbers
        as the whole revolution. Arrays are reused: allocating them would cost more than the
        computation.

        Parameters
        ----------
        world_from_base : float64 array, shape (states, 7)
            States of consecutive ticks of the whole revolution, at least two. Only those around
            the firings are used.
        start_seconds : float
            Time from the first state to the first firing of the revolution.
        firings : range
            Firings to compute.
        """
        states = np.ascontiguousarray(world_from_base, np.float64)
        outputs = *self.poses, self.origins_in_world, self.directions_in_world
        kernels().groundlink_sweep(
            *(ctypes.byref(self.head), states.ctypes.data, len(states)),
            *(start_seconds / TICK_SECONDS, firings.start, firings.stop),
            *(output.ctypes.data for output in outputs),
        )
        intervals = len(states) - 1
        if self._timed != (start_seconds, intervals):
            self._timed = start_seconds, intervals
            times = np.clip((start_seconds + self.seconds) / (intervals * TICK_SECONDS), 0, 1)
            np.copyto(self.times, times, casting="same_kind")


def unit_vectors(azimuth: Floats, elevation: Floats) -> Floats:
    """Return directions, shape (3, lasers, firings): x forward, y left, z up.

    Parameters
    ----------
    azimuth, elevation : float64 arrays that broadcast to (lasers, firings)
        Radians.
    """
    up = np.broadcast_to(np.sin(elevation), azimuth.shape)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up])


def ahead_by_encoder_deg(spec: RotatingLidar) -> Floats:
    """Return by how much the head is ahead of an even rotation, due to its encoder's steps.

    Returns
    -------
    float64 array, shape (firings,)
        Degrees, at most half the encoder's resolution either way.
    """
    firing, step_deg = np.arange(spec.firings_in_view), spec.azimuth_resolution_deg
    if not step_deg:
        return np.zeros(len(firing))
    read = firing - firing % spec.firings_per_azimuth
    turned_deg = read * (360 / spec.firings_per_revolution) + SIGNS[spec.rotation] * spec.start_deg
    ahead: Floats = np.rint(turned_deg / step_deg) * step_deg - turned_deg
    return ahead


def _per_laser(values: tuple[float, ...], lasers: int) -> Floats:
    return np.array(values or (0.0,) * lasers)
