# SPDX-License-Identifier: Apache-2.0
"""A camera: an eye with a lens and an image sensor, or several side by side.

Rule: light goes through the lens, onto rows that are exposed when the shutter says, behind the
colour filter, and is read with noise. What becomes of the picture is the sensor's business. Lenses
and image sensors that are ideal cost nothing. Eyes of one camera take their pictures at once,
through lenses and with image sensors of one kind; each has its own noise.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Optics
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.gl.target import COLOR_ALONE, Frame, Layer
from services.sensors.rendering.optics.distortion import lens_pinhole, slopes
from services.sensors.rendering.optics.imager import Electronics
from services.sensors.rendering.optics.lens import Lens
from services.sensors.rendering.optics.shutter import Shutter

from .eye import Eye
from .messages import ENCODINGS


class CameraEye:
    """What a camera of a scenario reads.

    Parameters
    ----------
    encoding : str
        Of `ENCODINGS`; those of one number a pixel have their colour filter before the noise.
    layers : collection of Layer
        What is drawn; depth is, too, where the lens needs it.
    to_the_right_m : sequence of float
        How far to the right of the mount each eye is.

    Raises
    ------
    RenderingUnavailableError
        when OpenGL is missing here or does not draw (a `UserError`).
    UserError
        when the lens cannot be drawn.

    Attributes
    ----------
    eye : Eye
        At the mount, through the lens's pinhole.
    pinhole : Pinhole
        Size of the picture, and K.
    slopes : float array, shape (height, width, 2)
        Where the ray of each pixel passes z of 1; NaN for no ray.
    span_nanos : int
        For how long a picture is exposed.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        spec: Optics,
        *,
        encoding: str = "rgb8",
        layers: Collection[Layer] = COLOR_ALONE,
        to_the_right_m: Sequence[float] = (0.0,),
    ) -> None:
        self.pinhole = lens_pinhole(spec)
        self.slopes = slopes(spec.lens, self.pinhole)
        self._lens = Lens(spec.lens, self.pinhole)
        self._shutter = Shutter(spec.imager, spec.height)
        self.span_nanos = self._shutter.span_nanos
        self.eye = Eye(
            scenario,
            vehicle,
            spec,
            pinhole=self._lens.drawn,
            span_nanos=self.span_nanos,
            layers={*layers, "depth"} if spec.lens.aperture_m else layers,
        )
        self._is_colored = "color" in layers
        coloured = encoding in ("rgb8", "bgr8")
        self._filtered = ENCODINGS["rgb8" if coloured else encoding]
        values = spec.width * spec.height * (3 if coloured else 1)
        name = f"{vehicle.name}/{spec.name}"
        names = [name, *(f"{name}/eye_{number}" for number in range(1, len(to_the_right_m)))]
        self._electronics = [
            Electronics(spec.imager, values, RandomStreams(scenario.seed, each)) for each in names
        ]
        self._optical_from_eye = np.tile(np.eye(4), (len(names), 1, 1))
        self._optical_from_eye[:, 0, 3] = to_the_right_m
        self.eye.renderer.exposure = self._electronics[0].brightness

    def read(self, nanos: int, tick: int, *, eye: int = 0) -> NDArray[np.uint8]:
        """Return the picture whose exposure begins at a sim time, with the noise of a tick.

        Shape (height, width, 3), red, green, blue, or (height, width) where the encoding has one
        number a pixel. The next look may overwrite it.
        """
        light = self._shutter.exposed(lambda offset: self._seen(nanos + offset, eye).colour)
        return self._electronics[eye].read(self._filtered(light), tick)

    def taken(self, nanos: int, tick: int) -> Frame:
        """Return that picture of the first eye with the truth in the middle of the exposure.

        Depth and labels are behind the lens, each pixel that of the nearest drawn one.
        """
        colour = None
        if self._is_colored and not self._shutter.is_still:
            colour = self.read(nanos, tick)
        middle = self._seen(nanos + self._shutter.middle_nanos, 0)
        if self._is_colored and colour is None:
            colour = self._electronics[0].read(self._filtered(middle.colour), tick)
        return middle if colour is None else replace(middle, colour=colour)

    def _seen(self, nanos: int, eye: int) -> Frame:
        """Return what is behind the lens of an eye at a sim time, as for `Eye.move`."""
        world_from_eye = self.eye.move(nanos) @ self._optical_from_eye[eye]
        return self._lens.seen(self.eye.renderer.draw(world_from_eye))
