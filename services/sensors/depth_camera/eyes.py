# SPDX-License-Identifier: Apache-2.0
"""Where a depth camera has true depth from: drawn by OpenGL, or by rays where there is none.

Rule: both see the same world through the same pinhole at the asked instant; by rays there is no
colour.
"""

from __future__ import annotations

import sys
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from groundlink.frames import transform
from groundlink.messages import State
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import DepthCamera
from services.sensors.rays.replica import Replica
from services.sensors.rendering.context import RenderingUnavailableError, open_context
from services.sensors.rendering.pinhole import NEAR_M, Pinhole

FAR_M = 1e5
"""Farther than any world goes."""


class Sight(NamedTuple):
    """What is seen. The arrays are overwritten by the next look."""

    depth_m: NDArray[np.float32]
    """Shape (height, width), infinite in the sky."""

    colour: NDArray[np.uint8] | None
    """Shape (height, width, 3)."""


class DepthEye(Protocol):
    """States of the world in, depths of an instant out; as `Eye` otherwise."""

    pinhole: Pinhole

    def restart(self) -> None:
        """Forget all states."""

    def take(self, state: State) -> None:
        """Remember where everything is at the next tick."""

    def look(self, nanos: int) -> Sight:
        """Return what is seen at a sim time between the last two states."""


class DrawnEye:
    """Depth and colour by OpenGL."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: DepthCamera) -> None:
        open_context().release()  # what is missing is told by this
        from services.sensors.rendering.eye import Eye  # needs moderngl

        self._eye = Eye(scenario, vehicle, spec)
        self.pinhole = self._eye.pinhole
        self.restart, self.take = self._eye.restart, self._eye.take

    def look(self, nanos: int) -> Sight:
        """Return what is seen at a sim time between the last two states."""
        frame = self._eye.look(nanos)
        return Sight(frame.depth_m, frame.colour)


class RayEye:
    """Depth alone, by a ray through the centre of each pixel."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: DepthCamera) -> None:
        self.pinhole = Pinhole.of(spec)
        self._replica = Replica(scenario, vehicle, spec.mount.xyz_m)
        self._base_from_optical = transform(spec.mount.xyz_m, spec.mount.quaternion(optical=True))
        shape = self.pinhole.height, self.pinhole.width
        self._rays = np.moveaxis(self.pinhole.rays(), -1, 0).reshape(3, -1).astype(np.float32)
        self._instants = np.zeros(shape, np.float32)
        self.restart = self._replica.restart

    def take(self, state: State) -> None:
        """Remember where everything is at the next tick."""
        self._replica.take(state)
        self._replica.forget(state.tick - 1)

    def look(self, nanos: int) -> Sight:
        """Return what is seen at a sim time between the last two states."""
        poses = self._replica.at(nanos)
        self._replica.scene.move(np.stack([poses, poses]))
        base = poses[self._replica.base]
        world_from_optical = transform(base[:3], base[3:]) @ self._base_from_optical
        shape = (3, *self._instants.shape)
        rays = (world_from_optical[:3, :3].astype(np.float32) @ self._rays).reshape(shape)
        # As drawn pictures, begin a little in front of the eye.
        at = world_from_optical[:3, 3, None, None] + NEAR_M * rays
        hits = self._replica.scene.cast(at.astype(np.float32), rays, self._instants, FAR_M)
        return Sight(hits.range_m + np.float32(NEAR_M), None)


def depth_eye(scenario: Scenario, vehicle: Vehicle, spec: DepthCamera) -> DepthEye:
    """Return an eye that draws or, if that cannot be here, casts rays, which it says in a line.

    Raises
    ------
    RenderingUnavailableError
        when OpenGL is missing here or does not draw, and colour is wanted.
    """
    try:
        return DrawnEye(scenario, vehicle, spec)
    except RenderingUnavailableError as error:
        if spec.color:
            raise
        print(f"measures depth by rays: {error}", file=sys.stderr, flush=True)
        return RayEye(scenario, vehicle, spec)
