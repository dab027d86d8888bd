# SPDX-License-Identifier: Apache-2.0
"""Scenario fields of a camera's lens and image sensor.

The defaults are ideal: a pinhole, and all pixels exposed at one instant without noise. The effects
on pictures are in `services.sensors.rendering`: `lens`, `shutter` and `imager`.
"""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import NonNegative, Positive, Spec

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
