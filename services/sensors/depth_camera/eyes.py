# SPDX-License-Identifier: Apache-2.0
"""Sources of true depth for a depth camera: OpenGL rendering, or ray casting without OpenGL.

Both sources see the same world through the same lens, in the middle of the exposure. Ray casting
yields no color.
"""

import sys
from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.frames import Floats, transform
from groundlink.messages.base import State
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.rays.replica import Replica
from services.sensors.rendering.gl.context import RenderingUnavailableError, open_context
from services.sensors.rendering.gl.pinhole import NEAR_M, Pinhole
from services.sensors.rendering.optics.distortion import lens_pinhole, slopes
from services.sensors.runtime.model import StreamMessage

from .spec import DepthCamera

FAR_M = 1e5
"""Distance beyond the far end of any world."""


class Sight(NamedTuple):
    """Rendered depth and color."""

    depth_m: NDArray[np.float32]
    """Shape (height, width). Infinite in the sky and where the lens receives no ray."""

    color: NDArray[np.uint8] | None
    """Shape (height, width, 3)."""


class DepthEye(Protocol):
    """Interface of a depth source: states in, depth at an instant out. Otherwise as `CameraEye`."""

    pinhole: Pinhole
    slopes: Floats
    span_nanos: int

    def restart(self) -> None:
        """Forget all states."""

    def take(self, state: State) -> None:
        """Store the pose of every link at the next tick."""

    def look(self, nanos: int, tick: int) -> Sight:
        """Return the exposure that begins at a sim time, with the noise of a tick."""

    def labels(self, nanos: int, stamp_nanos: int) -> Iterable[StreamMessage]:
        """Return the labels of the picture that `look` returned last, with its stamp."""


class DrawnEye:
    """Depth and color by OpenGL."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: DepthCamera) -> None:
        open_context().release()  # fails with the reason if OpenGL is unavailable
        # These need moderngl.
        from services.sensors.labels.picture_labels import PictureLabels
        from services.sensors.rendering.cameras.camera_eye import CameraEye
        from services.sensors.rendering.gl.target import Layer

        self._is_colored = bool(spec.color or spec.points_topic)
        layers: tuple[Layer, ...] = ("color", "depth") if self._is_colored else ("depth",)
        if spec.labels:
            layers = (*layers, "labels", "soils")
        self._camera = CameraEye(scenario, vehicle, spec, layers=layers)
        self._labels = PictureLabels(scenario, vehicle, spec, self._camera) if spec.labels else None
        self.pinhole, self.slopes = self._camera.pinhole, self._camera.slopes
        self.span_nanos = self._camera.span_nanos
        self.restart, self.take = self._camera.eye.restart, self._camera.eye.take

    def look(self, nanos: int, tick: int) -> Sight:
        """Return the exposure that begins at a sim time, with the noise of a tick."""
        frame = self._taken = self._camera.taken(nanos, tick)
        return Sight(frame.depth_m, frame.color if self._is_colored else None)

    def labels(self, nanos: int, stamp_nanos: int) -> Iterable[StreamMessage]:
        """Return the labels of the picture that `look` returned last, with its stamp."""
        if self._labels is None:
            return ()
        return self._labels.of_picture(self._taken, nanos, stamp_nanos)


class RayEye:
    """Depth without color, by one ray through the center of each pixel."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: DepthCamera) -> None:
        self.pinhole = lens_pinhole(spec)
        self.slopes = slopes(spec.lens, self.pinhole)
        self.span_nanos = round(spec.imager.span_s * NANOS)
        self._replica = Replica(scenario, vehicle, spec.mount)
        self._base_from_optical = transform(spec.mount.xyz_m, spec.mount.quaternion(optical=True))
        shape = self.pinhole.height, self.pinhole.width
        self._lit = np.isfinite(self.slopes[..., 0])
        rays = np.ones((*shape, 3), np.float32)
        rays[..., :2] = np.where(self._lit[..., None], self.slopes, 0)
        self._rays = np.moveaxis(rays, -1, 0).reshape(3, -1)
        self._instants = np.zeros(shape, np.float32)
        self.restart = self._replica.restart

    def take(self, state: State) -> None:
        """Store the pose of every link at the next tick."""
        self._replica.take(state)
        self._replica.forget(state.tick - 1 - -(-self.span_nanos // TICK_NANOS))

    def look(self, nanos: int, tick: int) -> Sight:
        """Return the depth in the middle of an exposure that begins at a sim time."""
        self._replica.press(nanos // TICK_NANOS)
        poses = self._replica.at(nanos + self.span_nanos // 2)
        self._replica.scene.move(np.stack([poses, poses]))
        base = poses[self._replica.carrier]
        world_from_optical = transform(base[:3], base[3:]) @ self._base_from_optical
        shape = (3, *self._instants.shape)
        rays = (world_from_optical[:3, :3].astype(np.float32) @ self._rays).reshape(shape)
        # The rays begin at the near plane, as in rendered pictures.
        at = world_from_optical[:3, 3, None, None] + NEAR_M * rays
        hits = self._replica.scene.cast(at.astype(np.float32), rays, self._instants, FAR_M)
        depth_m = np.where(self._lit, hits.range_m + np.float32(NEAR_M), np.float32(np.inf))
        return Sight(depth_m, None)

    def labels(self, nanos: int, stamp_nanos: int) -> Iterable[StreamMessage]:
        """Return no labels."""
        return ()


def depth_eye(scenario: Scenario, vehicle: Vehicle, spec: DepthCamera) -> DepthEye:
    """Return an OpenGL depth source or, with a log line, a ray-casting one without OpenGL.

    Raises
    ------
    RenderingUnavailableError
        when color or labels are enabled, but OpenGL is missing or can't draw on this machine.
    """
    try:
        return DrawnEye(scenario, vehicle, spec)
    except RenderingUnavailableError as error:
        if spec.color or spec.labels:
            raise
        print(f"measures depth by rays: {error}", file=sys.stderr, flush=True)
        return RayEye(scenario, vehicle, spec)
