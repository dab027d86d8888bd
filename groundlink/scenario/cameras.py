# SPDX-License-Identifier: Apache-2.0
"""What cameras can be told, with the defaults of an ideal one.

Rule: as in `sensors`; what all cameras have is `Optics`.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from groundlink.core.fields import Positive

from .every_sensor import Rate, SensorSpec
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
