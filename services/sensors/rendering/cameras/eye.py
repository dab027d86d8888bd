# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera on a vehicle's mount: states in, pictures of an instant out.

Camera and world are those of the requested instant, interpolated between two states. The sensor
decides when pictures are taken.
"""

from collections.abc import Collection

import numpy as np

from groundlink.core.clock import TICK_NANOS
from groundlink.core.frames import Floats, transform
from groundlink.messages.base import State
from groundlink.scenario.cameras import Optics
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.renderer import Renderer
from services.sensors.rendering.gl.target import Frame, Layer
from services.sensors.runtime.world_replica import WorldReplica

STEPS_PER_UNIT = 2.0**20
"""Poses are rounded to a micrometer, and quaternions alike: less than a thousandth of a pixel. A
vehicle at rest trembles by less than that, and its pictures are drawn once."""


class Eye:
    """The view of a scenario's camera.

    Parameters
    ----------
    pinhole : Pinhole, optional
        Pinhole to draw through instead of the specification's: wider for a lens with distortion.
    span_nanos : int
        How far before the last tick an instant may be.
    layers : collection of Layer
        Layers of the frames.

    Raises
    ------
    RenderingUnavailableError
        If OpenGL is missing or does not draw (a `UserError`).

    Attributes
    ----------
    pinhole : Pinhole
    renderer : Renderer
    around : WorldReplica
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        spec: Optics,
        *,
        pinhole: Pinhole | None = None,
        span_nanos: int = 0,
        layers: Collection[Layer] = ("color", "depth"),
    ) -> None:
        self._span_nanos = span_nanos
        self.pinhole = pinhole or Pinhole.of(spec)
        self.around = WorldReplica(scenario, vehicle, spec.mount)
        self._base_from_optical = transform(spec.mount.xyz_m, spec.mount.quaternion(optical=True))
        self.renderer = Renderer(
            scenario.world, self.around, self.pinhole, layers=layers, samples=spec.samples
        )

    def restart(self) -> None:
        """Forget all states."""
        self.around.restart()

    def take(self, state: State) -> None:
        """Store the poses of the next tick, and keep those of the span before it.

        Raises
        ------
        BadBusMessage
            If a vehicle or a link is missing.
        """
        self.around.take(state)
        self.around.forget(state.tick - 1 - -(-self._span_nanos // TICK_NANOS))

    def move(self, nanos: int) -> Floats:
        """Set the world to a sim time; return world_from_optical at that time, shape (4, 4).

        The time is between the oldest stored state and the newest.
        """
        # Adding 0.0 turns -0.0 into 0.0, which has other bytes.
        if self.around.press(nanos // TICK_NANOS) and self.around.ruts is not None:
            self.renderer.press(self.around.ruts)
        poses = np.rint(self.around.at(nanos) * STEPS_PER_UNIT) / STEPS_PER_UNIT + 0.0
        self.renderer.place(poses)
        base = poses[self.around.carrier]
        world_from_optical: Floats = transform(base[:3], base[3:]) @ self._base_from_optical
        return world_from_optical

    def look(self, nanos: int) -> Frame:
        """Return the view at a sim time, as for `move`."""
        return self.renderer.draw(self.move(nanos))
