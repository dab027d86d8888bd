# SPDX-License-Identifier: Apache-2.0
"""Images, compressed images and camera calibrations."""

import io
import zlib
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .base import Floats, Samples, TopicReadings

ENCODINGS = {
    **{name: ("u1", 3) for name in ("rgb8", "bgr8", "8UC3")},
    **{name: ("u1", 4) for name in ("rgba8", "bgra8", "8UC4")},
    **{name: ("u1", 1) for name in ("mono8", "8UC1", "8SC1")},
    **{name: ("u2", 1) for name in ("mono16", "16UC1", "16SC1")},
    **{name: ("u2", 3) for name in ("rgb16", "bgr16", "16UC3", "16SC3")},
    **{name: ("u2", 4) for name in ("rgba16", "bgra16", "16UC4")},
    **{f"bayer_{order}8": ("u1", 1) for order in ("rggb", "bggr", "gbrg", "grbg")},
    **{f"bayer_{order}16": ("u2", 1) for order in ("rggb", "bggr", "gbrg", "grbg")},
    **{name: ("u1", 2) for name in ("yuv422", "yuv422_yuy2", "uyvy", "yuyv", "8UC2", "8SC2")},
    **{name: ("u1", 1) for name in ("nv12", "nv21", "nv24")},
    **{name: ("i4", 1) for name in ("32SC1",)},
    **{f"32FC{count}": ("f4", count) for count in (1, 2, 3, 4)},
    **{f"64FC{count}": ("f8", count) for count in (1, 2, 3, 4)},
}
"""Encodings of sensor_msgs/image_encodings.hpp: type of a channel, and channels."""

DEPTH = ("16UC1", "32FC1", "mono16")
"""Encodings of depth images; mono16 is what REP 118 allows for older drivers."""


class ImageHeader(NamedTuple):
    """Numbers of a sensor_msgs/Image."""

    encoding: str
    height: int
    width: int
    step: int
    length: int


@dataclass(frozen=True)
class ImageSample:
    """A decoded image."""

    gray: Floats
    """Brightness, 0 to 255, or depth in the unit of the encoding."""
    levels: NDArray[np.int64]
    """How often each of the 256 levels of 8 bits occurs; empty for depth."""


class ImageReadings(TopicReadings):
    """Readings of sensor_msgs/Image and sensor_msgs/CompressedImage."""

    types = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")

    def prepare(self) -> None:
        """Create the lists."""
        self.headers: list[ImageHeader] = []
        """One a message; of compressed images only the encoding, if decoded also the size."""
        self.images: Samples[ImageSample] = Samples(most=12)
        self._profiles: list[Floats] = []
        self._sums: list[int] = []
        self.fails: list[bool] = []
        """Of each image, whether it could not be decoded."""

    def take(self, index: int, message: Any) -> None:
        """Take the header and a profile; keep some images."""
        data = np.asarray(message.data, np.uint8).reshape(-1)
        self._sums.append(zlib.crc32(data.tobytes()))
        is_raw = hasattr(message, "encoding")
        if is_raw:
            header = ImageHeader(
                str(message.encoding),
                int(message.height),
                int(message.width),
                int(message.step),
                len(data),
            )
            gray = _gray(header, data, bool(message.is_bigendian))
        else:
            gray = _decoded(str(message.format), data)
            height, width = gray.shape if gray is not None else (0, 0)
            header = ImageHeader(str(message.format), height, width, 0, len(data))
        self.headers.append(header)
        self.fails.append(gray is None)
        if gray is None:
            return
        if gray.dtype == np.uint8:
            self._profiles.append(gray.mean(axis=0, dtype=np.float64))
        if self.images.wants(index):
            levels = np.zeros(0, np.int64)
            if gray.dtype == np.uint8:
                levels = np.bincount(gray.reshape(-1), minlength=256)
            self.images.keep(index, ImageSample(gray.astype(np.float64), levels))

    def finish(self) -> None:
        """Make the arrays."""
        self.checksums = np.array(self._sums, np.int64)
        self.profiles: Floats | None = None
        """Mean brightness of each column in each image, if all are pictures of one size."""
        widths = {len(one) for one in self._profiles}
        if len(self._profiles) == len(self.headers) and len(widths) == 1:
            self.profiles = np.array(self._profiles, np.float64)

    @property
    def undecoded(self) -> int:
        """How many images could not be decoded."""
        return sum(self.fails)

    @property
    def is_raw(self) -> bool:
        """Whether the images are uncompressed."""
        return self.type == "sensor_msgs/msg/Image"

    @property
    def is_depth(self) -> bool:
        """Whether the pixels are distances, by encoding and name."""
        if not self.headers or "label" in self.name:
            return False
        encoding = self.headers[0].encoding
        return encoding in DEPTH[:2] or (encoding == DEPTH[2] and "depth" in self.name)

    @property
    def is_picture(self) -> bool:
        """Whether the pixels are brightness: images of labels or depth are none."""
        return not self.is_depth and self.profiles is not None and "label" not in self.name


class CameraInfoReadings(TopicReadings):
    """Readings of sensor_msgs/CameraInfo, of ROS 1 (K, D, R, P) and ROS 2 (k, d, r, p)."""

    types = ("sensor_msgs/msg/CameraInfo",)

    def prepare(self) -> None:
        """Create the lists."""
        self.sizes: set[tuple[int, int]] = set()
        """Height and width, as they appear."""
        self.models: set[str] = set()

    def take(self, index: int, message: Any) -> None:
        """Take the sizes, and the matrices of the first message."""
        self.sizes.add((int(message.height), int(message.width)))
        self.models.add(str(message.distortion_model))
        if index:
            return
        lower = hasattr(message, "k")
        self.k = np.array(message.k if lower else message.K, np.float64).reshape(3, 3)
        self.d = np.array(message.d if lower else message.D, np.float64).reshape(-1)
        self.r = np.array(message.r if lower else message.R, np.float64).reshape(3, 3)
        self.p = np.array(message.p if lower else message.P, np.float64).reshape(3, 4)


def _gray(header: ImageHeader, data: NDArray[np.uint8], is_bigendian: bool) -> NDArray[Any] | None:
    """Return brightness as uint8, or depth in its own type; None if the layout is unsound."""
    encoding, height, width, stride, length = header
    if encoding not in ENCODINGS or length != stride * height or not height * width:
        return None
    kind, channels = ENCODINGS[encoding]
    size = np.dtype(kind).itemsize * channels * width
    if stride < size or encoding.startswith("nv"):
        return None
    rows = np.ascontiguousarray(data.reshape(height, stride)[:, :size])
    pixels = rows.view(np.dtype(kind).newbyteorder(">" if is_bigendian else "<"))
    pixels = pixels.reshape(height, width, channels)
    if encoding in ("yuv422", "uyvy"):
        return np.asarray(pixels[:, :, 1])
    if encoding in ("yuv422_yuy2", "yuyv"):
        return np.asarray(pixels[:, :, 0])
    if channels == 1:
        return np.asarray(pixels[:, :, 0])
    if kind == "u1":
        return np.asarray(pixels[:, :, :3].mean(axis=2).astype(np.uint8))
    return None


def _decoded(encoding: str, data: NDArray[np.uint8]) -> NDArray[Any] | None:
    """Return the brightness of a JPEG or PNG picture; None if Pillow is missing or it is none."""
    if "compressedDepth" in encoding:
        return None
    try:
        from PIL import Image as pillow
    except ImportError:
        return None
    try:
        picture = pillow.open(io.BytesIO(data.tobytes()))
        if picture.mode not in ("L", "RGB", "RGBA"):
            return None
        return np.asarray(picture.convert("L"))
    except OSError:
        return None
