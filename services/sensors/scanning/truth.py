# SPDX-License-Identifier: Apache-2.0
"""Ground truth of a scan: the points that rays hit, as they are at the scan's stamp.

Computed in float64 from true directions and true ranges, without noise or rounding. A point on a
moving body moves with it from its ray's instant to the stamp. Points are in the sensor's frame at
the stamp.

Poses between two states are interpolated as the sensor's own are (`sweep.c`). Casting interpolates
differently (`rays.scene`): on the tread of a wheel of 0.2 m at 20 rad/s, the two are at most
0.06 mm apart.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_NANOS
from groundlink.core.frames import Floats, matrix_from_quaternion, nlerp, quaternion_from_rpy
from groundlink.scenario.every_sensor import Mount
from services.sensors.rays.replica import Replica
from services.sensors.rays.scene import Hits, Numbers, Reals

from .beams import Rays
from .returns import Returns


class TrueReturns(NamedTuple):
    """Ground truth of returns; undefined where nothing returned."""

    points_in_sensor: Reals
    """Shape (3, returns, lasers, firings), meters."""

    body: NDArray[np.uint32]
    """Shape (returns, lasers, firings): bodies, numbered as in `groundlink.scene.bodies`."""


class Cast(NamedTuple):
    """Firings of a revolution, cast together and measured."""

    returns: Returns
    rays: Rays
    hits: Hits
    """Of these rays; overwritten by the next cast."""

    motion: Floats
    """Shape (states, bodies, 7): world_from_body at the ticks of the revolution."""

    first_tick: int
    """Tick of the first of these states."""


class TrueView:
    """Computes ground truth for a sensor on a mount."""

    def __init__(self, replica: Replica, mount: Mount) -> None:
        self._replica = replica
        self._base_from_sensor = matrix_from_quaternion(quaternion_from_rpy(*mount.rpy_radians()))
        self._eye_in_base = np.array(mount.xyz_m)

    def see(self, cast: Cast, firings: slice, stamp_nanos: int) -> TrueReturns:
        """Return the ground truth of the returns of some firings at a sim time.

        Parameters
        ----------
        cast : Cast
        firings : slice
            Firings of the cast.
        stamp_nanos : int
            Not before the block of these firings begins: earlier states are not kept.
        """
        returns, rays, motion = cast.returns.of(firings), cast.rays, cast.motion
        stamp_ticks = (stamp_nanos - cast.first_tick * TICK_NANOS) / TICK_NANOS
        beams = rays.times.shape[:2]
        beam = np.arange(np.prod(beams)).reshape(beams)[:, firings]
        ray = (beam * (rays.times.size // np.prod(beams)) + returns.ray).ravel()
        # A return from a surface is a mean over a beam's rays; air has no hits.
        own_range_m = cast.hits.range_m.ravel()[ray].reshape(returns.label.shape)
        met = np.where(returns.label >= 0, own_range_m, returns.true_range_m)
        range_m = np.where(returns.returned, met, 0).astype(np.float64).ravel()
        origins, directions = (array.reshape(3, -1).take(ray, axis=1) for array in rays[:2])
        in_world: Floats = origins + range_m * directions

        moving = np.flatnonzero(returns.returned & (returns.body >= 0))
        if len(moving):
            body = returns.body.ravel()[moving]
            ticks = rays.times.ravel()[ray[moving]] * np.float64(len(motion) - 1)
            at_stamp = np.full_like(ticks, stamp_ticks)
            then, world_from_body_then = _poses(motion, ticks, body)
            now, world_from_body_now = _poses(motion, at_stamp, body)
            in_body = np.einsum("nji,jn->ni", world_from_body_then, in_world[:, moving] - then.T)
            in_world[:, moving] = np.einsum("nij,nj->in", world_from_body_now, in_body) + now.T

        base_body = np.array([self._replica.carrier])
        (base,), (world_from_base,) = _poses(motion, np.array([stamp_ticks]), base_body)
        eye = base + world_from_base @ self._eye_in_base
        sensor_from_world = (world_from_base @ self._base_from_sensor).T
        points = sensor_from_world @ in_world - (sensor_from_world @ eye)[:, None]
        return TrueReturns(
            points.astype(np.float32).reshape(3, *returns.returned.shape),
            self._replica.body_numbers(returns.label, returns.body),
        )


def _poses(motion: Floats, ticks: Floats, body: Numbers) -> tuple[Floats, Floats]:
    """Return positions, shape (N, 3), and rotations, (N, 3, 3), of N bodies, each at its tick."""
    before = np.clip(ticks.astype(np.intp), 0, len(motion) - 2)
    fraction = ticks - before
    first, second = motion[before, body], motion[before + 1, body]
    positions = first[:, :3] + fraction[:, None] * (second - first)[:, :3]
    return positions, matrix_from_quaternion(nlerp(first[:, 3:], second[:, 3:], fraction))
