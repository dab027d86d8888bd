# SPDX-License-Identifier: Apache-2.0
"""What cameras can be told, with the defaults of an ideal one.

Rule: as in `sensors`; what all cameras have is `Optics`.
"""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from groundlink.core.fields import Positive
from groundlink.messages.base import BusMessage
from groundlink.messages.imagery import CompressedImage, Image

from .every_sensor import Carrier, Rate, SensorSpec
from .lenses import Imager, Lens

FieldOfView = Annotated[float, Meta(ge=1, le=170)]


class Optics(SensorSpec, frozen=True, kw_only=True):
    """What all cameras have: a lens, an image sensor, a rate. `frame` is the optical one."""

    optical: ClassVar[bool] = True

    rate_hz: Rate = 30.0
    width: Annotated[int, Meta(ge=16, le=4096)] = 640
    height: Annotated[int, Meta(ge=16, le=4096)] = 480
    horizontal_fov_deg: FieldOfView | None = None
    vertical_fov_deg: FieldOfView | None = None
    """From edge to edge. One of the two makes square pixels; without both, 60 degrees vertical."""

    intrinsics: tuple[Positive, Positive, float, float] | None = None
    """fx, fy, cx, cy of K in pixels, instead of angles; pixel centres are whole numbers."""

    samples: Literal[1, 4, 16] = 4
    """Samples of light in each pixel, whose mean is its color. More make edges smoother; 1 draws
    jagged edges."""

    lens: Lens = Lens()
    imager: Imager = Imager()

    def __post_init__(self) -> None:
        if self.intrinsics and (self.horizontal_fov_deg or self.vertical_fov_deg):
            raise ValueError("`intrinsics` and an angle of view are both given; choose one")
        if self.imager.span_s * self.rate_hz > 1:
            raise ValueError(
                f"`exposure_s` and `readout_s` make {self.imager.span_s:g} s; expected up to "
                f"{1 / self.rate_hz:.4g} s, the time between two pictures"
            )

    @property
    def measuring_s(self) -> float:
        """Time of exposure and readout."""
        return self.imager.span_s


JPEG_NOISE = ((1, 50, 80, 90, 95, 100), (0.42, 0.42, 0.68, 0.91, 1.19, 2.0))
"""Bytes per pixel of a JPEG of random colors, by quality. The curve bends upwards, so straight
lines between these points are above it. A room at 80 takes a seventh of it."""

JPEG_HEAD_BYTES = 1000
"""Tables and headers of a JPEG."""


def jpeg_bytes(pixels: int, quality: int) -> int:
    """Return how large a JPEG of pure noise gets."""
    return math.ceil(pixels * np.interp(quality, *JPEG_NOISE)) + JPEG_HEAD_BYTES


def largest_picture(
    camera: Optics, frame: str, publish: str, encoding: str, quality: int
) -> BusMessage:
    """Return the pixels of a camera, or the JPEG of pure noise where only that is published."""
    pixels = camera.width * camera.height
    if publish == "compressed":
        return CompressedImage(0, frame, "jpeg", memoryview(bytes(jpeg_bytes(pixels, quality))))
    row = camera.width * (3 if encoding in ("rgb8", "bgr8") else 1)
    data = memoryview(bytes(row * camera.height))
    return Image(0, frame, camera.height, camera.width, encoding, row, data)


class Camera(Optics, frozen=True, tag="camera", kw_only=True):
    """A colour or grey camera; `topic` is that of its images as image_transport names them."""

    encoding: Literal["rgb8", "bgr8", "mono8", "bayer_rggb8"] = "rgb8"
    publish: Literal["compressed", "raw", "both"] = "compressed"
    """JPEG under `<topic>/compressed`, pixels under `topic`, or both."""

    jpeg_quality: Annotated[int, Meta(ge=1, le=100)] = 80

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.encoding.startswith("bayer") and self.publish != "raw":
            raise ValueError("a bayer pattern does not survive JPEG; add `publish: raw`")

    def ros_topics(self) -> dict[str, str]:
        """Return its topics as image_transport names them, and of the CameraInfo beside them."""
        namespace = self.topic.rpartition("/")[0]
        topics = {} if self.publish == "raw" else {"": f"{self.topic}/compressed"}
        if self.publish != "compressed":
            topics["image"] = self.topic
        return topics | {"camera_info": f"{namespace}/camera_info"}

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return a picture of pure noise."""
        frame = carrier.frame_prefix + self.frame
        return largest_picture(self, frame, self.publish, self.encoding, self.jpeg_quality)
