# SPDX-License-Identifier: Apache-2.0
"""Render targets, and the arrays into which pictures are read.

A pixel's color is the mean of the light of its samples in linear space, so edges have intermediate
pixels. Depth and labels are those at the pixel's center and are never averaged. The top row comes
first.
"""

from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats

Number = TypeVar("Number", bound=np.generic)

Layer = Literal["color", "depth", "labels", "soils"]
"""`soils` gives each material of the terrain a label of its own."""

COLOR_ALONE: tuple[Layer, ...] = ("color",)
COLOR_AND_LABELS: tuple[Layer, ...] = ("color", "labels", "soils")
ALL_LAYERS: tuple[Layer, ...] = ("color", "depth", "labels")

FINER = {1: 1, 4: 1, 16: 2}
"""Rendered pixels along each side of an output pixel, by samples per pixel. A rendered pixel has up
to four samples."""

MARGIN = 2.0
"""Pixels around the projections of points in which what they enclose is drawn."""

MOST_AT_ONCE = 4
"""Samples of a rendered pixel that OpenGL 3.3 guarantees."""


@dataclass(frozen=True)
class Frame:
    """One picture. The arrays are read-only, because the renderer may return them again.

    A layer that the renderer does not draw is empty.
    """

    color: NDArray[np.uint8]
    """Shape (height, width, 3), uint8: red, green, blue, gamma-encoded."""

    depth_m: NDArray[np.float32]
    """Shape (height, width), meters along z of the optical frame; infinite in the sky."""

    labels: NDArray[np.int32] | None
    """Shape (height, width): numbers of `Renderer.labels`, -1 in the sky; None if not drawn."""

    def counts(self, most: int) -> NDArray[np.intp]:
        """Return the pixels of each label below `most`; labels must be drawn."""
        assert self.labels is not None
        return np.bincount(self.labels.ravel() + 1, minlength=most + 1)[1:]


class ColorTarget:
    """Render target of colors.

    Parameters
    ----------
    samples : int
        Samples per pixel: a key of `FINER`.
    """

    truth = False

    def __init__(self, context: moderngl.Context, width: int, height: int, samples: int) -> None:
        self._context = context
        finer, at_once = FINER[samples], min(samples, MOST_AT_ONCE) if samples > 1 else 0
        size = finer * width, finer * height
        self._drawn = context.texture(size, 4, samples=at_once)
        self._frame = context.framebuffer(
            [self._drawn], context.depth_renderbuffer(size, samples=at_once)
        )
        self._resolved = (
            context.framebuffer([context.texture((width, height), 4)]) if at_once else None
        )
        self._shape = height, width, 3

    def begin(self) -> None:
        """Clear depth and colors: an alpha of 0 stands for no surface."""
        self._frame.use()
        self._frame.clear()

    def end(self, sky: moderngl.VertexArray) -> None:
        """Draw the sky behind the surfaces, and average the samples."""
        if self._resolved:
            self._resolved.use()
            self._context.disable(moderngl.DEPTH_TEST)
            self._drawn.use(0)
        sky.render(vertices=3)

    def read(self) -> NDArray[np.uint8]:
        """Return the picture."""
        color = np.empty(self._shape, np.uint8)
        return _read_only(self._resolved or self._frame, color, components=3)


class TruthTarget:
    """Render target of depth and labels: one sample per pixel, at its center."""

    truth = True

    def __init__(self, context: moderngl.Context, width: int, height: int, *, labels: bool) -> None:
        size = (width, height)
        self._size = size
        layers = [context.texture(size, 1, dtype="f4")]
        if labels:
            layers.append(context.texture(size, 1, dtype="i4"))
        nearest = context.depth_renderbuffer(size)
        self._frame = context.framebuffer(layers, nearest)
        self._nearest = context.framebuffer(depth_attachment=nearest)
        self._has_labels = labels

    def begin(self) -> None:
        """Clear the depth. The sky covers all that nothing else covers."""
        self._nearest.use()
        self._nearest.clear()
        self._frame.use()

    def begin_part(self, corners: Floats, clip_from_world: Floats) -> int:
        """Clear the depth where points of the world, shape (N, 3), may be, and draw only there.

        `end_part` ends it.

        Returns
        -------
        Number of pixels of this rectangle, at least one.
        """
        clip = corners @ clip_from_world[:, :3].T + clip_from_world[:, 3]
        low, high = np.zeros(2), np.array(self._size)
        if np.all(clip[:, 3] > 0):
            places = (clip[:, :2] / clip[:, 3:] + 1) / 2 * self._size
            low = np.clip(np.floor(places.min(axis=0)) - MARGIN, 0, high - 1)
            high = np.clip(np.ceil(places.max(axis=0)) + MARGIN, low + 1, high)
        left, top, width, height = np.concatenate([low, high - low]).astype(int).tolist()
        self._frame.scissor = left, top, width, height
        self._nearest.use()
        self._nearest.clear(viewport=self._frame.scissor)
        self._frame.use()
        return int(width * height)

    def end_part(self) -> None:
        """Draw everywhere again."""
        self._frame.scissor = 0, 0, *self._size

    def end(self, sky: moderngl.VertexArray) -> None:
        """Draw the sky behind the surfaces."""
        sky.render(vertices=3)

    def read(self) -> tuple[NDArray[np.float32], NDArray[np.int32] | None]:
        """Return depth, and labels if they are drawn."""
        shape = self._size[::-1]
        depth_m = _read_only(self._frame, np.empty(shape, np.float32), dtype="f4")
        if not self._has_labels:
            return depth_m, None
        labels = np.empty(shape, np.int32)
        return depth_m, _read_only(self._frame, labels, attachment=1, dtype="i4")


def _read_only(
    frame: moderngl.Framebuffer, pixels: NDArray[Number], *, components: int = 1, **options: Any
) -> NDArray[Number]:
    """Return `pixels`, filled from a frame and read-only from now on."""
    frame.read_into(pixels, components=components, alignment=1, **options)
    pixels.flags.writeable = False
    return pixels
