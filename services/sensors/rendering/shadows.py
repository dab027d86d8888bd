# SPDX-License-Identifier: Apache-2.0
"""Shadow maps: what each light sees, drawn once and mended where something moves.

Rule: a map is a function of where everything is now, whatever came before. Only the rectangle in
which a vehicle was or is gets drawn anew: what stands there, then all that moves. Maps hold the
far sides of things, so that no surface shadows itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from groundlink.frames import Floats

from .culling import seen
from .lights import Light
from .stage import Outline, Stage
from .uniforms import put_matrix

TEXELS = 1536
"""Along each side of a light's map; the maps lie side by side. More would not stay in a cache."""

MARGIN = 2
"""Texels around a vehicle's outline that are drawn anew, too."""

Rectangle = tuple[int, int, int, int]
"""Left, low, right and high in texels of one map."""

_WHOLE = (0, 0, TEXELS, TEXELS)


class ShadowMaps:
    """The depth that each light sees.

    Attributes
    ----------
    texture : moderngl.Texture
        All maps, from left to right.
    mended : int
        Rectangles drawn anew so far.
    """

    def __init__(
        self,
        context: moderngl.Context,
        stage: Stage,
        program: moderngl.Program,
        lights: Sequence[Light],
    ) -> None:
        self._context, self._stage, self._program, self._lights = context, stage, program, lights
        self.texture = context.depth_texture((len(lights) * TEXELS, TEXELS))
        self.texture.compare_func = "<="
        self.texture.repeat_x = self.texture.repeat_y = False
        self._frame = context.framebuffer(depth_attachment=self.texture)
        self.forget()
        self.mended = 0

    def forget(self) -> None:
        """Draw all anew at the next update: something stands where nothing stood."""
        self._drawn: list[Outline] | None = None

    def update(self) -> None:
        """Draw what is not as the stage is."""
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._context.cull_face = "front"
        vehicles = self._stage.vehicles
        for number in range(len(self._lights)):
            if self._drawn is None:
                self._draw(number, _WHOLE)
                continue
            for before, now in zip(self._drawn, vehicles, strict=True):
                if not np.array_equal(before.poses, now.poses):
                    corners = np.concatenate([before.corners, now.corners])
                    self._draw(number, self._rectangle(number, corners))
                    self.mended += 1
        self._drawn = list(vehicles)
        self._context.cull_face = "back"

    def _rectangle(self, number: int, corners: Floats) -> Rectangle:
        """Return where points of the world, shape (..., 3), are on a light's map."""
        matrix = self._lights[number].clip_from_world
        clip = corners.reshape(-1, 3) @ matrix[:, :3].T + matrix[:, 3]
        if np.any(clip[:, 3] <= 0):
            return _WHOLE
        texels = (clip[:, :2] / clip[:, 3:] + 1) / 2 * TEXELS
        left, low = np.clip(np.floor(texels.min(axis=0)) - MARGIN, 0, TEXELS).astype(int).tolist()
        right, high = np.clip(np.ceil(texels.max(axis=0)) + MARGIN, 0, TEXELS).astype(int).tolist()
        return left, low, right, high

    def _draw(self, number: int, rectangle: Rectangle) -> None:
        left, low, right, high = rectangle
        if left >= right or low >= high:
            return
        clip_from_world = self._lights[number].clip_from_world
        frame, shift = self._frame, number * TEXELS
        frame.viewport = (shift, 0, TEXELS, TEXELS)
        frame.scissor = (shift + left, low, right - left, high - low)
        frame.use()
        frame.clear(viewport=frame.scissor)
        put_matrix(self._program, "clip_from_world", clip_from_world)
        shown = seen(self._stage.boxes, _cropped(clip_from_world, rectangle))
        for chunk in np.flatnonzero(shown).tolist():
            self._stage.standing[chunk].shadow.render()
        for part in self._stage.moving:
            part.shadow.render(instances=part.instances)


def _cropped(clip_from_world: Floats, rectangle: Rectangle) -> Floats:
    """Return the view through a rectangle of a map alone."""
    left, low, right, high = (2 * edge / TEXELS - 1 for edge in rectangle)
    cropped = clip_from_world.copy()
    for row, (least, most) in enumerate(((left, right), (low, high))):
        cropped[row] = (2 * cropped[row] - (most + least) * cropped[3]) / (most - least)
    return cropped
