# SPDX-License-Identifier: Apache-2.0
"""Pictures as PNG files.

A JSON file beside the picture of labels maps its colors to objects.
"""

import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from services.sensors.rendering.gl.target import Frame
from services.sensors.rendering.look.labels import NONE, Labels

FARTHEST_M = 65.535
"""Largest depth in meters that 16 bits of millimeters hold."""


def write(folder: Path, prefix: str, frame: Frame, labels: Labels) -> list[Path]:
    """Write `<prefix>_colour.png`, `_depth.png`, `_labels.png` and `_labels.json`; return them.

    Colors with one number a pixel make a gray picture. Depth is in millimeters, 16 bits; 0 is the
    sky or beyond `FARTHEST_M`. Each object has its own color in the picture of labels; black is the
    sky.

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
