# SPDX-License-Identifier: Apache-2.0
"""What a camera's lens and its image sensor can be told.

Rule: every field at its default is ideal: a pinhole, and all pixels at one instant without noise.
What the fields mean for pictures is in `services.sensors.rendering`: `lens`, `shutter`, `imager`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec

COEFFICIENTS = {
    "plumb_bob": ("k1", "k2", "p1", "p2", "k3"),
    "equidistant": ("k1", "k2", "k3", "k4"),
}
"""Of each model, as sensor_msgs/distortion_models names and orders them."""


class Lens(Spec, frozen=True, kw_only=True):
    """What a lens does to a picture."""

    model: Literal["plumb_bob", "equidistant"] = "plumb_bob"
    """A usual lens, or a fisheye, whose distance from the middle grows with the angle."""

    distortion: tuple[float, ...] = ()
    """k1, k2, p1, p2, k3 of plumb_bob (k1 below zero is a barrel, above it a pincushion), or k1 to
    k4 of equidistant; missing ones are zero. Angles of view are those with all at zero."""

    chromatic_aberration: Annotated[float, Meta(ge=-0.05, le=0.05)] = 0.0
    """By which share red's image is larger than green's, and blue's smaller."""

    vignetting: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """v of 1 / (1 + v r^2)^2, the light that is left; r is 1 in the farthest corner."""

    aperture_m: NonNegative = 0.0
    """Diameter of the opening, focal length by f-number; 0 has all distances in focus."""

    focus_m: Positive = 2.0
    """Distance along the optical axis that is sharp."""

    def __post_init__(self) -> None:
        names = COEFFICIENTS[self.model]
        if len(self.distortion) > len(names):
            raise ValueError(
                f"`distortion` has {len(self.distortion)} numbers; {self.model} takes up to "
                f"{len(names)}: {', '.join(names)}"
            )

    @property
    def is_straight(self) -> bool:
        """Whether straight lines stay straight: nothing is distorted."""
        return self.model == "plumb_bob" and not any(self.distortion)

    @property
    def coefficients(self) -> tuple[float, ...]:
        """All of the model, as in CameraInfo."""
        missing = len(COEFFICIENTS[self.model]) - len(self.distortion)
        return (*self.distortion, *(0.0,) * missing)


class Imager(Spec, frozen=True, kw_only=True):
    """How an image sensor makes numbers of light."""

    exposure_s: Annotated[float, Meta(ge=0, le=0.1)] = 0.0
    """For how long each row is exposed; 10 ms are as bright as the ideal instant, 0."""

    gain: Positive = 1.0
    """Factor of brightness behind the noise of light, so that noise grows with it."""

    readout_s: Annotated[float, Meta(ge=0, le=0.1)] = 0.0
    """How much later than the first row the last one begins: a rolling shutter."""

    poses: Annotated[int, Meta(ge=1, le=64)] = 1
    """Views drawn for one picture, over exposure and readout: more than one for motion blur and
    rolling shutter. Each costs a drawing."""

    full_well_electrons: NonNegative = 0.0
    """Of a pixel at full scale and gain 1, of which shot noise follows; 0 for no noise at all."""

    read_noise_electrons: NonNegative = 0.0
    """1 sigma, of each pixel."""

    black_level: Annotated[float, Meta(ge=0, lt=1)] = 0.0
    """What a dark pixel says, as a share of full scale, in linear light."""

    def __post_init__(self) -> None:
        if self.read_noise_electrons and not self.full_well_electrons:
            raise ValueError("`read_noise_electrons` needs `full_well_electrons` to measure by")
        moves = self.exposure_s or self.readout_s
        if self.poses > 1 and not moves:
            raise ValueError("`poses` above 1 needs `exposure_s` or `readout_s` to spread over")
        if self.readout_s and self.poses == 1:
            raise ValueError("`readout_s` needs `poses` above 1, as rows differ by them")

    @property
    def span_s(self) -> float:
        """From the first row's beginning to the last one's end."""
        return self.exposure_s + self.readout_s
