# SPDX-License-Identifier: Apache-2.0
"""Camera: one eye or several side by side, with lens and image sensor.

Light passes the lens and the color filter, hits rows that the shutter exposes, and is read with
noise. Ideal lenses and image sensors cost nothing. The eyes of one camera expose at the same time
and have equal lenses and image sensors; each has its own noise.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario.cameras import Optics
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.gl.target import COLOR_ALONE, Frame, Layer
from services.sensors.rendering.optics.distortion import lens_pinhole, slopes
from services.sensors.rendering.optics.imager import Electronics
from services.sensors.rendering.optics.lens import LensOptics
from services.sensors.rendering.optics.shutter import Shutter

from .eye import Eye
from .messages import ENCODINGS


class _Seen(NamedTuple):
    """A picture of one eye."""

    drawn: Frame
    behind_lens: Frame


class CameraEye:
    """The pictures of a scenario's camera.

    Parameters
    ----------
    encoding : str
        One of `ENCODINGS`. Those with one number a pixel apply their color filter before noise.
    layers : collection of Layer
        Layers of the pictures. Depth is also drawn where the lens needs it.
    to_the_right_m : sequence of float
        Distance of each eye to the right of the mount.

    Raises
    ------
    RenderingUnavailableError
        If OpenGL is missing or does not draw (a `UserError`).
    UserError
        If the lens can't be drawn.

    Attributes
    ----------
    eye : Eye
        The eye at the mount, with the lens's pinhole.
    pinhole : Pinhole
        Size of the picture, and K.
    slopes : float array, shape (height, width, 2)
        Where the ray of each pixel passes the plane z = 1; NaN for no ray.
    span_nanos : int
        Duration of a picture's exposure.
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
        self._lens = LensOptics(spec.lens, self.pinhole)
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
        colored = encoding in ("rgb8", "bgr8")
        self._filtered = ENCODINGS["rgb8" if colored else encoding]
        values = spec.width * spec.height * (3 if colored else 1)
        name = f"{vehicle.name}/{spec.name}"
        names = [name, *(f"{name}/eye_{number}" for number in range(1, len(to_the_right_m)))]
        self._electronics = [
            Electronics(spec.imager, values, RandomStreams(spec.noise_seed(scenario.seed), each))
            for each in names
        ]
        self._seen_last: list[_Seen | None] = [None] * len(names)
        self._optical_from_eye = np.tile(np.eye(4), (len(names), 1, 1))
        self._optical_from_eye[:, 0, 3] = to_the_right_m
        self.eye.renderer.exposure = self._electronics[0].brightness

    def read(self, nanos: int, tick: int, *, eye: int = 0) -> NDArray[np.uint8]:
        """Return the picture whose exposure begins at a sim time, with the noise of a tick.

        Shape (height, width, 3), red, green, blue, or (height, width) for encodings with one number
        a pixel. Don't change it: it may be returned again.
        """
        light = self._shutter.exposed(lambda offset: self._seen(nanos + offset, eye).color)
        return self._electronics[eye].read(self._filtered(light), tick)

    def taken(self, nanos: int, tick: int) -> Frame:
        """Return the same picture of the first eye, with the truth at the middle of the exposure.

        Depth and labels are behind the lens: each pixel has those of the nearest drawn pixel.
        """
        color = None
        if self._is_colored and not self._shutter.is_still:
            color = self.read(nanos, tick)
        middle = self._seen(nanos + self._shutter.middle_nanos, 0)
        if self._is_colored and color is None:
            color = self._electronics[0].read(self._filtered(middle.color), tick)
        return middle if color is None else replace(middle, color=color)

    def visible_shares(self, labels: Sequence[int]) -> list[float]:
        """Return the visible share of objects in the picture that `taken` returned last.

        Of what the pinhole shows, which is a little more than the picture if the lens distorts.
        """
        return self.eye.renderer.visible_shares(labels)

    def poses(self, nanos: int) -> Floats:
        """Return world_from_link in the middle of the exposure that begins at a sim time."""
        return self.eye.around.at(nanos + self._shutter.middle_nanos)

    def _seen(self, nanos: int, eye: int) -> Frame:
        """Return the picture behind the lens of an eye at a sim time, as for `Eye.move`."""
        world_from_eye = self.eye.move(nanos) @ self._optical_from_eye[eye]
        drawn, seen = self.eye.renderer.draw(world_from_eye), self._seen_last[eye]
        if seen is None or seen.drawn is not drawn:
            seen = self._seen_last[eye] = _Seen(drawn, self._lens.seen(drawn))
        return seen.behind_lens
