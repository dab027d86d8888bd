# SPDX-License-Identifier: Apache-2.0
"""Snapshot: a camera that takes one picture with color, depth and labels, and its files.

The color is what the camera's process publishes at that instant, before JPEG and without faults.
Depth and labels are the truth behind the same lens at the middle of the exposure, without a depth
camera's noise and holes. A stereo pair's snapshot is that of its left eye.
"""

import json
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.messages.base import BusMessage, State
from groundlink.scenario.cameras import Optics
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.rendering.cameras.camera_eye import CameraEye
from services.sensors.rendering.gl.target import ALL_LAYERS, Frame
from services.sensors.rendering.look.labels import NONE, Labels


class Snapshot:
    """A `SensorModel` that takes one picture.

    Attributes
    ----------
    frame : Frame or None
        The picture, once taken; its colors have the shape that `CameraEye.read` returns.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Optics, at_nanos: int) -> None:
        self._camera = CameraEye(
            scenario, vehicle, spec, encoding=spec.color_encoding, layers=ALL_LAYERS
        )
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


FARTHEST_M = 65.535
"""Largest depth in meters that 16 bits of millimeters hold."""


def write(folder: Path, prefix: str, frame: Frame, labels: Labels) -> list[Path]:
    """Write `<prefix>_colour.png`, `_depth.png`, `_labels.png` and `_labels.json`; return them.

    Colors with one number a pixel make a gray picture. Depth is in millimeters, 16 bits; 0 is the
    sky or beyond `FARTHEST_M`. Each object has its own color in the picture of labels; black is the
    sky. The JSON file maps these colors to objects.

    Raises
    ------
    UserError
        If a file can't be written.
    """
    assert frame.labels is not None
    depth_m = np.where(frame.depth_m <= FARTHEST_M, frame.depth_m, 0).astype(np.float64)
    palette = np.vstack([colors(len(labels.instances)), [[0, 0, 0]]])  # -1 is the last one
    pictures: dict[str, NDArray[np.uint8 | np.uint16]] = {
        "colour": frame.color[..., ::-1] if frame.color.ndim == 3 else frame.color,
        "depth": np.rint(1000 * depth_m).astype(np.uint16),
        "labels": palette.astype(np.uint8)[frame.labels][..., ::-1],
    }
    shown = np.unique(frame.labels)
    legend = {
        "#{:02x}{:02x}{:02x}".format(*palette[label].tolist()): {
            "instance": labels.instances[label],
            "class": labels.classes[label],
        }
        for label in shown[shown != NONE].tolist()
    }
    files = {name: folder / f"{prefix}_{name}.png" for name in pictures}
    explained = folder / f"{prefix}_labels.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, file in files.items():
            file.write_bytes(
                cv2.imencode(".png", np.ascontiguousarray(pictures[name]))[1].tobytes()
            )
        explained.write_text(json.dumps(legend, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise UserError(f"{folder}: {(error.strerror or str(error)).lower()}") from None
    return [*files.values(), explained]


def colors(count: int) -> NDArray[np.uint8]:
    """Return different colors, shape (count, 3); adjacent numbers differ strongly in hue."""
    number = np.arange(count)
    hue = number * 111 % 180  # OpenCV halves degrees; the only common factor of 111 and 180 is 3
    saturation, value = 255 - 45 * (number // 60 % 4), 255 - 70 * (number % 3)
    hsv = np.stack([hue, saturation, value], axis=-1).astype(np.uint8)[None]
    return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0], np.uint8)
