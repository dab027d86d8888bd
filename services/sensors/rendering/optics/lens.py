# SPDX-License-Identifier: Apache-2.0
"""Lens: the picture behind a lens, from a picture drawn through a pinhole.

The pinhole is wide enough for every pixel that receives light, so distortion leaves no black
corners. Only a fisheye's picture is black beyond its circle of `MAX_FIELD_DEG`. Green follows K and
the coefficients exactly; red and blue are scaled. Depth and labels are those of the nearest drawn
pixel: z stays along the optical axis. An ideal lens costs nothing.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario import cameras
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.gl.target import Frame

from .distortion import slopes

DIAMETERS = (0.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Diameters of the circles of confusion for which pictures are blurred, pixels."""

NEAREST_M = 1e-3

GAUSSIAN_SIGMAS = 3.0
"""Radius at which OpenCV ends the blur of a picture with 8 bits, in sigmas."""


class Focus:
    """Depth of field: blur what is nearer or farther than the focus distance.

    Thin lens model (Potmesil and Chakravarty 1981, "A lens and aperture camera model for synthetic
    image generation"): a point at depth z has a circle of confusion of f A |1/z - 1/z_f| pixels in
    diameter. Blurs between those of `DIAMETERS` are mixed from two pictures. Larger blurs are not
    modeled, nor is the seam between a sharp object and a blurred one behind it.

    Parameters
    ----------
    spread_px_m : float
        Focal length in pixels times aperture in meters.
    focus_m : float
    """

    def __init__(self, spread_px_m: float, focus_m: float) -> None:
        self._spread_px_m, self._focus_m = spread_px_m, focus_m

    def diameters(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the diameter of the circle of confusion at each depth, pixels."""
        nearer = 1 / np.maximum(depth_m, NEAREST_M) - 1 / self._focus_m
        return np.asarray(np.abs(self._spread_px_m * nearer), np.float32)

    def seen(self, frame: Frame) -> NDArray[np.uint8]:
        """Return the colors of a frame, blurred by depth."""
        squared = np.minimum(self.diameters(frame.depth_m), DIAMETERS[-1]) ** 2
        made = frame.color.copy()
        for low, high in pairwise(DIAMETERS):
            # Wide blurs are expensive, and most pictures need them in some rows only.
            rows = np.flatnonzero((squared > low**2).any(axis=1))
            if not len(rows):
                break
            # The variance of a disc along a line is a sixteenth of its squared diameter. Variances
            # of mixed pictures add up in proportion.
            sigma_px = high / 4
            reach = math.ceil(GAUSSIAN_SIGMAS * sigma_px) + 1
            first, end = int(rows[0]), int(rows[-1]) + 1
            above = min(first, reach)
            around = frame.color[first - above : end + reach]
            more = cv2.GaussianBlur(around, (0, 0), sigma_px)[above:][: end - first]
            share = np.clip((squared[first:end] - low**2) / (high**2 - low**2), 0, 1)
            made[first:end] = cv2.blendLinear(made[first:end], more, 1 - share, share)
        return made


MOST_PIXELS = 4.0
"""Largest ratio of drawn pixels to picture pixels. Beyond it the middle is less sharp."""

MARGIN = 2.0
"""Margin of drawn pixels."""

NOWHERE = -10.0
"""Place of pixels that no light reaches: outside."""


class LensOptics:
    """The lens of one camera.

    Parameters
    ----------
    spec : cameras.Lens
    pinhole : Pinhole
        Size of the picture, and K.

    Raises
    ------
    UserError
        If the lens can't be drawn.

    Attributes
    ----------
    drawn : Pinhole
        Pinhole through which pictures have to be drawn.
    """

    def __init__(self, spec: cameras.Lens, pinhole: Pinhole) -> None:
        self.drawn = pinhole
        self._bend: _Bend | None = None
        self._coloring: list[Callable[[Frame], NDArray[np.uint8]]] = []
        colors = 1 + spec.chromatic_aberration * np.array([1.0, 0.0, -1.0])
        if spec.chromatic_aberration or not spec.is_straight:
            rays = [slopes(spec, pinhole, scale) for scale in dict.fromkeys(colors.tolist())]
            self.drawn = covering(pinhole, rays)
            self._bend = _Bend(self.drawn, rays)
        if spec.aperture_m:
            focal_px = (pinhole.fx + pinhole.fy) / 2
            self._coloring.append(Focus(focal_px * spec.aperture_m, spec.focus_m).seen)
        if spec.vignetting:
            left = _left(spec.vignetting, pinhole)
            self._coloring.append(
                lambda frame: np.asarray(cv2.multiply(frame.color, left, scale=1 / 255))
            )

    def seen(self, frame: Frame) -> Frame:
        """Return the picture behind the lens of a `frame` drawn through `drawn`; same layers."""
        if self._bend:
            frame = self._bend.bent(frame)
        if frame.color.size:
            for step in self._coloring:
                frame = replace(frame, color=step(frame))
        return frame


def covering(pinhole: Pinhole, rays: list[Floats]) -> Pinhole:
    """Return a pinhole that sees all `rays`, as sharp in its middle if the cost allows it."""
    every = np.concatenate([of.reshape(-1, 2) for of in rays])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    focal = np.array([pinhole.fx, pinhole.fy])
    needed = np.prod((high - low) * focal) / (pinhole.width * pinhole.height)
    focal *= min(1.0, (MOST_PIXELS / needed) ** 0.5)
    width, height = np.ceil((high - low) * focal + 2 * MARGIN).astype(int).tolist()
    cx, cy = (MARGIN - low * focal).tolist()
    fx, fy = focal.tolist()
    return Pinhole(width, height, fx, fy, cx, cy)


def _left(vignetting: float, pinhole: Pinhole) -> NDArray[np.uint8]:
    """Return factors of coded values, 255 for 1, shape (H, W, 3): roots of those of light."""
    x = np.arange(pinhole.width) - pinhole.cx
    y = (np.arange(pinhole.height) - pinhole.cy)[:, None]
    squared = x**2 + y**2
    left = 255 / (1 + vignetting * squared / squared.max())
    return np.repeat(np.rint(left).astype(np.uint8)[..., None], 3, axis=-1)


class _Bend:
    """Maps from a drawn picture to the picture behind the lens."""

    def __init__(self, drawn: Pinhole, rays: list[Floats]) -> None:
        focal, middle = np.array([drawn.fx, drawn.fy]), np.array([drawn.cx, drawn.cy])
        places = [
            np.where(np.isnan(of), NOWHERE, of * focal + middle).astype(np.float32) for of in rays
        ]
        none = np.empty(0, np.float32)
        self._colors = [cv2.convertMaps(place, none, cv2.CV_16SC2) for place in places]
        self._nearest = np.rint(places[len(places) // 2]).astype(np.int16)  # of green

    def bent(self, frame: Frame) -> Frame:
        color, depth_m, labels = frame.color, frame.depth_m, frame.labels
        if color.size:
            channels = cv2.split(color) if len(self._colors) > 1 else [color]
            bent = [
                cv2.remap(channel, whole, parts, cv2.INTER_LINEAR)
                for channel, (whole, parts) in zip(channels, self._colors, strict=True)
            ]
            color = np.asarray(cv2.merge(bent) if len(bent) > 1 else bent[0], np.uint8)
        if depth_m.size:
            depth_m = self._picked(depth_m, np.inf)
        if labels is not None:
            # Integers below 2^24 are exact in float32, which OpenCV can remap.
            labels = self._picked(labels.astype(np.float32), -1.0).astype(np.int32)
        return Frame(color, depth_m, labels)

    def _picked(self, pixels: NDArray[np.float32], outside: float) -> NDArray[np.float32]:
        none = np.empty(0, np.int16)
        nearest = cv2.INTER_NEAREST
        picked = cv2.remap(pixels, self._nearest, none, nearest, borderValue=outside)
        return np.asarray(picked, np.float32)
