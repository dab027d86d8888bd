# SPDX-License-Identifier: Apache-2.0
"""Thumbnails of a run's cameras, evenly spaced over the run.

Only the pictures shown are decoded. Pictures of an unknown encoding are counted.
"""

import base64
import io
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.ros.pixels import ENCODINGS, pixels

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")

SHOWN = 6
"""Pictures shown of a camera."""

WIDTH_PX = 320
MAX_COMPRESSED_BYTES = 400_000
"""Maximum size of a compressed picture in the page."""

_MAGIC = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG": "image/png"}


@dataclass
class CameraThumbnails:
    """One camera's pictures."""

    topic: str
    first_nanos: int
    last_nanos: int
    pictures: list[tuple[float, str]] = field(default_factory=list)
    """Time (s of the run) and data URI."""

    unknown: int = 0

    def is_due(self, nanos: int) -> bool:
        """Return whether the picture of this time is one of those to show."""
        taken = len(self.pictures) + self.unknown
        span = max(self.last_nanos - self.first_nanos, 1)
        return taken < SHOWN and nanos - self.first_nanos >= span * (taken + 0.5) / (SHOWN + 0.5)

    def add(self, seconds: float, message: Any) -> None:
        """Take a sensor_msgs/Image or CompressedImage."""
        uri = data_uri(message)
        if uri is None:
            self.unknown += 1
        else:
            self.pictures.append((seconds, uri))


def data_uri(message: Any) -> str | None:
    """Return a picture as a data URI, or None for an unknown encoding."""
    if not hasattr(message, "encoding"):
        data = bytes(message.data)
        kind = next((kind for magic, kind in _MAGIC.items() if data.startswith(magic)), None)
        return _uri(kind, data) if kind and len(data) <= MAX_COMPRESSED_BYTES else None
    shown = _thumbnail(message)
    return None if shown is None else png_uri(shown)


def _thumbnail(message: Any) -> NDArray[np.uint8] | None:
    """Return an Image as red, green, blue, shape (height, width, 3), thinned to `WIDTH_PX`."""
    height, width, step = message.height, message.width, message.step
    encoding = ENCODINGS.get(message.encoding)
    if encoding is None or not height or not width or len(message.data) < height * step:
        return None
    thin = max(-(-width // WIDTH_PX), 1)
    big = bool(message.is_bigendian)
    image = pixels(encoding, message.data, height, width, step, big=big)[::thin, ::thin]
    if image.dtype.itemsize > 1:
        return _gray(image.astype(np.float64))
    if image.ndim == 2:
        return np.repeat(image[:, :, None], 3, axis=2)
    return np.ascontiguousarray(image[:, :, [encoding.channels.index(color) for color in "RGB"]])


def _gray(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return depths as gray levels, near is bright, between the 2nd and 98th percentile."""
    known = values[np.isfinite(values) & (values > 0)]
    low, high = np.quantile(known, [0.02, 0.98]) if known.size else (0.0, 1.0)
    with np.errstate(invalid="ignore"):
        share = np.clip((high - values) / max(high - low, 1e-9), 0.0, 1.0)
    gray = np.where(np.isfinite(values) & (values > 0), 40 + 215 * share, 0.0).astype(np.uint8)
    return np.repeat(gray[:, :, None], 3, axis=2)


def png_uri(pixels: NDArray[np.uint8]) -> str:
    """Return pixels, shape (height, width, 3), as a PNG for a page."""
    from matplotlib.image import imsave

    buffer = io.BytesIO()
    imsave(buffer, pixels, format="png")
    return _uri("image/png", buffer.getvalue())


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
