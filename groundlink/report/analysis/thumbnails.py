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

IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")

SHOWN = 6
"""Pictures shown of a camera."""

WIDTH_PX = 320
MAX_COMPRESSED_BYTES = 400_000
"""Maximum size of a compressed picture in the page."""

_MAGIC = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG": "image/png"}

_COLORS = {
    "rgb8": (3, [0, 1, 2]),
    "bgr8": (3, [2, 1, 0]),
    "rgba8": (4, [0, 1, 2]),
    "bgra8": (4, [2, 1, 0]),
    "mono8": (1, [0, 0, 0]),
}
"""Channels of a pixel, and the indices of red, green and blue."""

_DEPTHS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}


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
    pixels = _pixels(message)
    return None if pixels is None else png_uri(pixels)


def _pixels(message: Any) -> NDArray[np.uint8] | None:
    """Return an Image as red, green, blue, shape (height, width, 3), thinned to `WIDTH_PX`."""
    height, width, step = message.height, message.width, message.step
    if not height or not width:
        return None
    rows = np.asarray(message.data, np.uint8)
    if rows.size < height * step:
        return None
    rows = rows[: height * step].reshape(height, step)
    thin = max(-(-width // WIDTH_PX), 1)
    if message.encoding in _COLORS:
        channels, order = _COLORS[message.encoding]
        image = rows[:, : width * channels].reshape(height, width, channels)
        return np.ascontiguousarray(image[::thin, ::thin][:, :, order])
    if message.encoding in _DEPTHS:
        dtype = np.dtype((">" if message.is_bigendian else "<") + _DEPTHS[message.encoding])
        depth = rows[:, : width * dtype.itemsize].copy().view(dtype)[::thin, ::thin]
        return _gray(depth.astype(np.float64))
    return None


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
