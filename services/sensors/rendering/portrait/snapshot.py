# SPDX-License-Identifier: Apache-2.0
"""A camera that takes one picture: colour, depth and labels.

Rule: colour is what the camera's process publishes of that instant, before JPEG and without faults.
Depth and labels are the truth behind the same lens, in the middle of the exposure: a depth camera's
noise and holes are not in them. Of a stereo pair it is the left eye.
"""

from __future__ import annotations

from collections.abc import Iterable

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Message, State
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Camera, Optics, StereoCamera
from services.sensors.rendering.cameras.camera_eye import CameraEye
from services.sensors.rendering.gl.target import ALL_LAYERS, Frame
from services.sensors.rendering.look.labels import Labels


class Snapshot:
    """A sensor that looks once (a `SensorModel`).

    Attributes
    ----------
    frame : Frame or None
        What it saw, once it has; colours have the shape that `CameraEye.read` says.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Optics, at_nanos: int) -> None:
        encoding = spec.encoding if isinstance(spec, Camera | StereoCamera) else "rgb8"
        self._camera = CameraEye(scenario, vehicle, spec, encoding=encoding, layers=ALL_LAYERS)
        self._at_nanos = at_nanos
        self._tick = -1
        self.frame: Frame | None = None

    @property
    def labels(self) -> Labels:
        """What the numbers in the frame stand for."""
        return self._camera.eye.renderer.labels

    def restart(self) -> None:
        """Forget earlier states."""
        self._camera.eye.restart()

    def settled_tick(self) -> int:
        """Return the last tick."""
        return self._tick

    def readings(self, state: State) -> Iterable[Message]:
        """Look when the exposure has ended; yield nothing."""
        camera, begin = self._camera, self._at_nanos
        camera.eye.take(state)
        self._tick = state.tick
        if self.frame is None and state.tick * TICK_NANOS >= begin + camera.span_nanos:
            # Noise is that of the first tick at or after the instant, as of a schedule's event.
            self.frame = camera.taken(begin, -(-begin // TICK_NANOS))
        return ()
