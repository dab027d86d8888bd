# SPDX-License-Identifier: Apache-2.0
"""Scenario fields that all kinds of cameras share; the defaults describe an ideal camera."""

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from groundlink.core.fields import Positive
from groundlink.messages.base import BusMessage
from groundlink.messages.imagery import CompressedImage, Image

from .every_sensor import Rate, SensorSpec
from .lenses import Imager, Lens

FieldOfView = Annotated[float, Meta(ge=1, le=170)]
Publish = Literal["compressed", "raw", "both"]
"""Forms in which a stream of images is published."""

JpegQuality = Annotated[int, Meta(ge=1, le=100)]


class Optics(SensorSpec, frozen=True, kw_only=True):
    """Base of all camera kinds: lens, image sensor and rate. `frame` is the optical frame."""

    optical: ClassVar[bool] = True

    rate_hz: Rate = 30.0
    width: Annotated[int, Meta(ge=16, le=4096)] = 640
    height: Annotated[int, Meta(ge=16, le=4096)] = 480
    horizontal_fov_deg: FieldOfView | None = None
    vertical_fov_deg: FieldOfView | None = None
    """Full angle between opposite edges of the image. If only one of the two fields of view is
    given, pixels are square; if neither is given, the vertical one is 60 degrees."""

    intrinsics: tuple[Positive, Positive, float, float] | None = None
    """fx, fy, cx and cy of K in pixels, instead of angles. Pixel centers have integer coordinates.
    """

    samples: Literal[1, 4, 16] = 4
    """Light samples in each pixel; their mean is the pixel's color. More samples give smoother
    edges; 1 gives jagged edges."""

    lens: Lens = Lens()
    imager: Imager = Imager()

    def __post_init__(self) -> None:
        if self.intrinsics and (self.horizontal_fov_deg or self.vertical_fov_deg):
            raise ValueError("`intrinsics` and a field of view are both given. Fix: keep one")
        if self.imager.span_s * self.rate_hz > 1:
            raise ValueError(
                f"`exposure_s` and `readout_s` make {self.imager.span_s:g} s; expected up to "
                f"{1 / self.rate_hz:.4g} s, the time between two pictures"
            )

    @property
    def measuring_s(self) -> float:
        """Return the time of exposure and readout, in seconds."""
        return self.imager.span_s

    @property
    def color_encoding(self) -> str:
        """Return the encoding of color pictures, as in sensor_msgs/Image."""
        return "rgb8"


def info_beside(topic: str) -> str:
    """Return the CameraInfo topic that belongs to an image topic, as named by image_transport."""
    return f"{topic.rpartition('/')[0]}/camera_info"


JPEG_NOISE = ((1, 50, 80, 90, 95, 100), (0.42, 0.42, 0.68, 0.91, 1.19, 2.0))
"""Bytes per pixel of a JPEG of random colors, by quality. The curve is convex, so linear
interpolation between the points overestimates it. At quality 80, an image of a room takes a
seventh of the value."""

JPEG_HEAD_BYTES = 1000
"""Bytes of the tables and headers of a JPEG."""


def jpeg_bytes(pixels: int, quality: int) -> int:
    """Return the size in bytes of a JPEG of pure noise."""
    return math.ceil(pixels * np.interp(quality, *JPEG_NOISE)) + JPEG_HEAD_BYTES


def largest_picture(
    camera: Optics, frame: str, publish: str, encoding: str, quality: int
) -> BusMessage:
    """Return the largest picture: raw pixels, or a JPEG of noise if only the JPEG is published."""
    pixels = camera.width * camera.height
    if publish == "compressed":
        return CompressedImage(0, frame, "jpeg", memoryview(bytes(jpeg_bytes(pixels, quality))))
    row = camera.width * (3 if encoding in ("rgb8", "bgr8") else 1)
    data = memoryview(bytes(row * camera.height))
    return Image(0, frame, camera.height, camera.width, encoding, row, data)
