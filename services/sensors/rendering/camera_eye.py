# SPDX-License-Identifier: Apache-2.0
"""An eye with a lens and an image sensor: the picture as a camera reads it.

Rule: light goes through the lens, onto rows that are exposed when the shutter says, behind the
colour filter, and is read with noise. What becomes of the picture is the sensor's business. Lenses
and image sensors that are ideal cost nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from groundlink.scenario import lenses
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Optics
from services.sensors.streams import RandomStreams

from .distortion import MODELS
from .eye import Eye
from .imager import Electronics
from .lens import Lens
from .messages import ENCODINGS
from .pinhole import Pinhole
from .shutter import Shutter
from .target import Frame

IDEAL_LENS, IDEAL_IMAGER = lenses.Lens(), lenses.Imager()


class CameraEye:
    """What a camera of a scenario reads.

    Parameters
    ----------
    encoding : str
        Of `ENCODINGS`; those of one number a pixel have their colour filter before the noise.

    Raises
    ------
    RenderingUnavailableError
        when OpenGL is missing here or does not draw (a `UserError`).
    UserError
        when the lens cannot be drawn.

    Attributes
    ----------
    eye : Eye
        Through the lens's pinhole.
    pinhole : Pinhole
        Size of the picture, and K.
    span_nanos : int
        For how long a picture is exposed.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        spec: Optics,
        *,
        lens: lenses.Lens = IDEAL_LENS,
        imager: lenses.Imager = IDEAL_IMAGER,
        encoding: str = "rgb8",
        with_labels: bool = False,
    ) -> None:
        self.pinhole = Pinhole.of(spec, radius=MODELS[lens.model].radius)
        self._lens = Lens(lens, self.pinhole)
        self._shutter = Shutter(imager, spec.height)
        self.span_nanos = self._shutter.span_nanos
        self.eye = Eye(
            scenario,
            vehicle,
            spec,
            pinhole=self._lens.drawn,
            span_nanos=self.span_nanos,
            with_labels=with_labels,
        )
        coloured = encoding in ("rgb8", "bgr8")
        self._filtered = ENCODINGS["rgb8" if coloured else encoding]
        values = spec.width * spec.height * (3 if coloured else 1)
        streams = RandomStreams(scenario.seed, f"{vehicle.name}/{spec.name}")
        self._electronics = Electronics(imager, values, streams)
        self.eye.renderer.exposure = self._electronics.brightness

    def seen(self, nanos: int) -> Frame:
        """Return what is behind the lens at a sim time, as for `Eye.move`."""
        return self._lens.seen(self.eye.look(nanos))

    def read(self, nanos: int, tick: int) -> NDArray[np.uint8]:
        """Return the picture whose exposure begins at a sim time, with the noise of a tick.

        Shape (height, width, 3), red, green, blue, or (height, width) where the encoding has one
        number a pixel. The next look may overwrite it.
        """
        light = self._shutter.exposed(lambda offset_nanos: self.seen(nanos + offset_nanos).colour)
        return self._electronics.read(self._filtered(light), tick)
