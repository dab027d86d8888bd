# SPDX-License-Identifier: Apache-2.0
"""Snapshot: a camera that takes one picture with color, depth and labels.

The color is what the camera's process publishes at that instant, before JPEG and without faults.
Depth and labels are the truth behind the same lens at the middle of the exposure, without a depth
camera's noise and holes. A stereo pair's snapshot is that of its left eye.
"""

from collections.abc import Iterable

from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import BusMessage, State
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Camera, Optics, StereoCamera
from services.sensors.rendering.cameras.camera_eye import CameraEye
from services.sensors.rendering.gl.target import ALL_LAYERS, Frame
from services.sensors.rendering.look.labels import Labels


class Snapshot:
    """A `SensorModel` that takes one picture.

    Attributes
    ----------
    frame : Frame or None
        The picture, once taken; its colors have the shape that `CameraEye.read` returns.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Optics, at_nanos: int) -> None:
        encoding = spec.encoding if isinstance(spec, Camera | StereoCamera) else "rgb8"
        self._camera = CameraEye(scenario, vehicle, spec, encoding=encoding, layers=ALL_LAYERS)
        self._at_nanos = at_nanos
        self._tick = -1
        self.frame: Frame | None = None

    @property
    def labels(self) -> Labels:
        """Meaning of the label numbers in the frame."""
        return self._camera.eye.renderer.labels

    def restart(self) -> None:
        """Forget earlier states."""
        self._camera.eye.restart()

    def settled_tick(self) -> int:
        """Return the last tick."""
        return self._tick

    def readings(self, state: State) -> Iterable[BusMessage]:
        """Take the picture when the exposure has ended; yield nothing."""
        camera, begin = self._camera, self._at_nanos
        camera.eye.take(state)
        self._tick = state.tick
        if self.frame is None and state.tick * TICK_NANOS >= begin + camera.span_nanos:
            # The noise is that of the first tick at or after the instant, as for an event of a
            # schedule.
            self.frame = camera.taken(begin, -(-begin // TICK_NANOS))
        return ()
