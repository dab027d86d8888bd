# SPDX-License-Identifier: Apache-2.0
"""Scenario fields that all kinds of cameras share: optics, lens and image sensor.

The defaults are ideal: a pinhole, and all pixels exposed at one instant without noise. The effects
on pictures are in `services.sensors.rendering.optics`.
"""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec
from groundlink.messages.base import BusMessage
from groundlink.messages.ground_truth import Detections2D, Detections3D, LabelTable
from groundlink.messages.imagery import CompressedImage, Image

from .every_sensor import Rate, SensorSpec

FieldOfView = Annotated[float, Meta(ge=1, le=170)]
Publish = Literal["compressed", "raw", "both"]
"""Forms in which a stream of images is published."""

JpegQuality = Annotated[int, Meta(ge=1, le=100)]

LABEL_STREAMS: Mapping[str, type[BusMessage]] = {
    "label_info": LabelTable,
    "semantic": Image,
    "instances": Image,
    "instance_info": LabelTable,
    "boxes_2d": Detections2D,
    "boxes_3d": Detections3D,
}
"""BusMessage type of each stream of labels; each kind of camera adds them to its own."""

_STREAMS_OF = {
    "segmentation": ("semantic", "instances", "instance_info"),
    "boxes_2d": ("boxes_2d",),
    "boxes_3d": ("boxes_3d",),
}
"""Streams of each form of labels, besides `label_info`, which all forms have."""

COEFFICIENTS = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "equidistant": ("k1", "k2", "k3", "k4"),
}
"""Coefficient names of each distortion model, in the order of sensor_msgs/distortion_models."""


class Lens(Spec, frozen=True, kw_only=True):
    """Optical errors of a lens."""

    model: Literal["plumb_bob", "equidistant"] = "plumb_bob"
    """`plumb_bob`: a conventional lens. `equidistant`: a fisheye lens, whose image radius grows
    with the angle."""

    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2, k3 of plumb_bob, or k1 to k4 of equidistant; missing coefficients are zero.
    k1 below zero gives a barrel distortion, above zero a pincushion distortion. Fields of view
    are those without distortion."""

    chromatic_aberration: Annotated[float, Meta(ge=-0.05, le=0.05)] = 0.0
    """Relative enlargement of the red image against the green one; the blue image shrinks by as
    much."""

    vignetting: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """v of 1 / (1 + v r^2)^2, the remaining share of the light; r is 1 in the farthest corner."""

    aperture_m: NonNegative = 0.0
    """Diameter of the aperture: focal length divided by f-number. 0: everything is in focus."""

    focus_m: Positive = 2.0
    """Focus distance along the optical axis."""

    def __post_init__(self) -> None:
        names = COEFFICIENTS[self.model]
        if len(self.distortion) > len(names):
            raise ValueError(
                f"`distortion` has {len(self.distortion)} numbers; {self.model} takes up to "
                f"{len(names)}: {', '.join(names)}"
            )

    @property
    def is_straight(self) -> bool:
        """Whether the image of a straight line is straight, that is, without distortion."""
        return self.model == "plumb_bob" and not any(self.distortion)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Return all coefficients of the model, as in CameraInfo."""
        missing = len(COEFFICIENTS[self.model]) - len(self.distortion)
        return (*self.distortion, *(0.0,) * missing)


class Imager(Spec, frozen=True, kw_only=True):
    """Exposure, noise and readout of an image sensor."""

    exposure_s: Annotated[float, Meta(ge=0, le=0.1)] = 0.0
    """Exposure time of each row. An exposure of 10 ms is as bright as the ideal exposure, 0."""

    gain: Positive = 1.0
    """Gain of the signal after the shot noise of light, so that it amplifies this noise."""

    readout_s: Annotated[float, Meta(ge=0, le=0.1)] = 0.0
    """Time from the start of the first row's exposure to the start of the last row's: rolling
    shutter."""

    poses: Annotated[int, Meta(ge=1, le=64)] = 1
    """Number of views rendered for one picture, over exposure and readout. Motion blur and rolling
    shutter need more than one. The rendering time is proportional to it."""

    full_well_electrons: NonNegative = 0.0
    """Electrons of a pixel at full scale and gain 1, which determine shot noise; 0 for no noise at
    all."""

    read_noise_electrons: NonNegative = 0.0
    """Read noise of each pixel, 1 sigma."""

    black_level: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    """Value of a dark pixel as a share of full scale, in linear light."""

    def __post_init__(self) -> None:
        if self.read_noise_electrons and not self.full_well_electrons:
            raise ValueError("`read_noise_electrons` needs `full_well_electrons`")
        moves = self.exposure_s or self.readout_s
        if self.poses > 1 and not moves:
            raise ValueError("`poses` above 1 needs `exposure_s` or `readout_s`")
        if self.readout_s and self.poses == 1:
            raise ValueError(
                "`readout_s` needs `poses` above 1: rows are rendered at different poses"
            )

    @property
    def span_s(self) -> float:
        """Return the time from the start of the first row's exposure to the last row's end."""
        return self.exposure_s + self.readout_s


class Optics(SensorSpec, frozen=True, kw_only=True):
    """Base of all camera kinds: lens, image sensor and rate. `frame` is the optical frame."""

    optical: ClassVar[bool] = True

    rate_hz: Rate = 30.0
    """Pictures per second of sim time."""

    width: Annotated[int, Meta(ge=16, le=4096)] = 640
    """Columns of the image, in pixels."""

    height: Annotated[int, Meta(ge=16, le=4096)] = 480
    """Rows of the image, in pixels."""

    horizontal_fov_deg: FieldOfView | None = None
    """Full angle between the left and the right edge of the image; none: follows from the vertical
    one."""

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
    """Optical errors of the lens; default: a pinhole."""

    imager: Imager = Imager()
    """Exposure, noise and readout of the image sensor; default: ideal."""

    labels: tuple[Literal["segmentation", "boxes_2d", "boxes_3d"], ...] = ()
    """Labels of each picture under `<topic>/labels`. `segmentation`: an image of classes and one of
    objects. `boxes_2d`: a box around the visible part of each object. `boxes_3d`: a box around each
    visible object, in the optical frame. Needs OpenGL. Default: none."""

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

    def label_topics(self) -> dict[str, str]:
        """Return the ROS topic of each stream of labels by name."""
        streams = ["label_info"] if self.labels else []
        streams += [stream for form in self.labels for stream in _STREAMS_OF[form]]
        return {stream: f"{self.topic}/labels/{stream}" for stream in streams}


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
    """Return the largest picture: raw pixels, or a JPEG of noise if only the JPEG is published.

    An image of objects has 16 bits a pixel.
    """
    pixels = camera.width * camera.height
    has_raw_colors = publish != "compressed" and encoding in ("rgb8", "bgr8")
    if "segmentation" in camera.labels and not has_raw_colors:
        publish, encoding = "raw", "mono16"
    if publish == "compressed":
        return CompressedImage(0, frame, "jpeg", memoryview(bytes(jpeg_bytes(pixels, quality))))
    row = camera.width * {"rgb8": 3, "bgr8": 3, "mono16": 2}.get(encoding, 1)
    data = memoryview(bytes(row * camera.height))
    return Image(0, frame, camera.height, camera.width, encoding, row, data)
