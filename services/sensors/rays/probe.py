# SPDX-License-Identifier: Apache-2.0
"""Ray probe: casts a few rays at one instant between the last two states.

For range finders and the like; a LiDAR's sweep has an instant for each ray.
"""

from typing import NamedTuple

import numpy as np

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.frames import Floats, matrix_from_quaternion, nlerp, quaternion_from_rpy
from groundlink.messages.base import State
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario, Vehicle

from .replica import Replica
from .scene import Hits, Numbers


class SensorPose(NamedTuple):
    """Pose of a sensor at an instant."""

    origin_in_world: Floats
    """Shape (3,), meters."""

    world_from_sensor: Floats
    """Rotation matrix, shape (3, 3)."""


class RayProbe:
    """The world around one sensor on a mount.

    Attributes
    ----------
    replica : Replica
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, mount: Mount) -> None:
        self.replica = Replica(scenario, vehicle, mount)
        self._sensor_in_base = np.array(mount.xyz_m)
        self._base_from_sensor = matrix_from_quaternion(quaternion_from_rpy(*mount.rpy_radians()))
        self._tick = 0

    def restart(self) -> None:
        """Forget all states."""
        self.replica.restart()

    def take(self, state: State) -> None:
        """Take the state of the next tick.

        Raises
        ------
        BadBusMessage
            when a vehicle or a link is missing.
        """
        self.replica.take(state)
        self.replica.forget(state.tick - 1)
        self._tick = state.tick

    def _share(self, nanos: int) -> float:
        """Return an instant as a fraction between the last two states, 0..1."""
        return 1.0 + (nanos - self._tick * TICK_NANOS) / TICK_NANOS

    def place(self, nanos: int) -> SensorPose:
        """Return the sensor's pose at a sim time between the last two states."""
        poses = self.replica.motion(self._tick - 1, self._tick)[:, self.replica.carrier]
        share = np.array(self._share(nanos))
        world_from_base = matrix_from_quaternion(nlerp(poses[0, 3:], poses[1, 3:], share))
        base = poses[0, :3] + share * (poses[1, :3] - poses[0, :3])
        return SensorPose(
            base + world_from_base @ self._sensor_in_base, world_from_base @ self._base_from_sensor
        )

    def velocities(self, nanos: int, points_in_world: Floats, body: Numbers) -> Floats:
        """Return the velocity of points that move with bodies, in m/s in the world.

        It is the mean over the last tick, so it is zero at the first state after a restart.

        Parameters
        ----------
        nanos
            As for `place`.
        points_in_world : shape (3, N)
        body : shape (N,)
            Body of each point (`Hits.body`); -1 for the static world.
        """
        before, after = self.replica.motion(self._tick - 1, self._tick)
        share = np.array(self._share(nanos))
        velocities = np.zeros_like(points_in_world)
        for number in np.unique(body[body >= 0]).tolist():
            here, then, now = body == number, before[number], after[number]
            position = then[:3] + share * (now[:3] - then[:3])
            turned = matrix_from_quaternion(nlerp(then[3:], now[3:], share))
            in_body = turned.T @ (points_in_world[:, here] - position[:, None])
            turn = matrix_from_quaternion(now[3:]) - matrix_from_quaternion(then[3:])
            moved = (now[:3] - then[:3])[:, None] + turn @ in_body
            velocities[:, here] = moved / (TICK_NANOS / NANOS)
        return velocities

    def cast(
        self, nanos: int, origin_in_world: Floats, directions_in_world: Floats, max_range_m: float
    ) -> Hits:
        """Return the hits of rays at a sim time.

        Parameters
        ----------
        nanos
            As for `place`.
        origin_in_world : shape (3,) or (3, rays)
        directions_in_world : shape (3, rays)
            Unit vectors.
        max_range_m
            Surfaces beyond are not hit.
        """
        scene = self.replica.scene
        self.replica.press(self._tick - 1)
        scene.move(self.replica.motion(self._tick - 1, self._tick))
        rays = directions_in_world.shape[1]
        origins = np.broadcast_to(origin_in_world.reshape(3, -1), (3, rays))
        return scene.cast(
            origins.astype(np.float32),
            directions_in_world.astype(np.float32),
            np.full(rays, self._share(nanos), np.float32),
            max_range_m,
        )
