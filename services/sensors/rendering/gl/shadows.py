# SPDX-License-Identifier: Apache-2.0
"""Shadow maps: the depth that each light sees, drawn once and repaired where something moves.

A map depends on the current poses only, not on what came before. A move redraws the rectangle in
which a vehicle was or is: static objects first, then everything that moves. Maps hold back faces,
and open surfaces slightly farther from the light, so that nothing shadows itself. In a wide world
one more map covers the area around the eye. Terrain is in no map: `ground_paint` computes its
shadows.
"""

import moderngl
import numpy as np

from groundlink.core.frames import Floats
from services.sensors.rendering.look.lights import Lighting, window

from .culling import seen
from .programs import put_matrix
from .stage import DrawCall, Outline, Stage

TEXELS = 1536
"""Texels along each side of a light's map; the maps are side by side. A larger map would not fit
into a cache."""

MARGIN = 2
"""Margin in texels around a vehicle's outline that is redrawn, too."""

OFFSET = (2.0, 2.0)
"""Offset of open surfaces away from the light, so that they don't shadow themselves: their slope
over a texel, since a lookup reads four texels, plus the resolution of depth."""

DEPTH_CLAMP = 0x864F
"""OpenGL's depth clamp: what is nearer to the sun than the map's view also casts its shadow."""

Rectangle = tuple[int, int, int, int]
"""Left, bottom, right and top in texels of one map."""

_WHOLE = (0, 0, TEXELS, TEXELS)


class ShadowMaps:
    """The shadow maps of all lights.

    Attributes
    ----------
    texture : moderngl.Texture
        All maps, from left to right; the map around the eye is the last one.
    mended : int
        Rectangles redrawn so far.
    """

    def __init__(
        self,
        context: moderngl.Context,
        stage: Stage,
        program: moderngl.Program,
        light: Lighting,
    ) -> None:
        self._context, self._stage, self._program, self._light = context, stage, program, light
        self._views = [one.clip_from_world for one in light.lights]
        self._views += [np.eye(4)] if light.window_m else []
        self.texture = context.depth_texture((len(self._views) * TEXELS, TEXELS))
        self.texture.compare_func = "<="
        self.texture.repeat_x = self.texture.repeat_y = False
        self._frame = context.framebuffer(depth_attachment=self.texture)
        self.forget()
        self.mended = 0

    def window_from_map(self) -> tuple[Floats, Floats]:
        """Return offset and scale from the sun's map to the map around the eye, each of shape (3,).

        Places on both maps range from 0 to 1. The scale is applied before the offset.
        """
        window_from_map = self._views[-1] @ np.linalg.inv(self._views[0])
        scale, shift = window_from_map.diagonal()[:3], window_from_map[:3, 3]
        return (shift - scale + 1) / 2, scale

    def forget(self) -> None:
        """Redraw everything at the next update, because a static object was added."""
        self._drawn: list[list[Outline] | None] = [None] * len(self._views)

    def update(self, eye: Floats) -> None:
        """Redraw what differs from the stage, for a view from a place in the world."""
        if self._light.window_m:
            around = window(self._light.lights[0], self._light.window_m, eye)
            if not np.array_equal(around, self._views[-1]):
                self._views[-1], self._drawn[-1] = around, None
        movers = self._stage.movers
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        if self._light.is_sun:
            self._context.enable_direct(DEPTH_CLAMP)
        self._context.cull_face = "front"
        for number, drawn in enumerate(self._drawn):
            if drawn is None:
                self._draw(number, _WHOLE)
                continue
            for before, now in zip(drawn, movers, strict=True):
                if before is not now and not np.array_equal(before.poses, now.poses):
                    corners = np.concatenate([before.corners, now.corners])
                    self._draw(number, self._rectangle(number, corners))
                    self.mended += 1
        self._drawn = [list(movers) for _ in self._views]
        self._context.cull_face = "back"
        self._context.disable_direct(DEPTH_CLAMP)

    def _rectangle(self, number: int, corners: Floats) -> Rectangle:
        """Return the rectangle that points of the world, shape (..., 3), cover on a light's map."""
        matrix = self._views[number]
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
        clip_from_world = self._views[number]
        frame, shift = self._frame, number * TEXELS
        frame.viewport = (shift, 0, TEXELS, TEXELS)
        frame.scissor = (shift + left, low, right - left, high - low)
        frame.use()
        frame.clear(viewport=frame.scissor)
        put_matrix(self._program, "clip_from_world", clip_from_world)
        shown = seen(self._stage.boxes, _cropped(clip_from_world, rectangle))
        for chunk in np.flatnonzero(shown).tolist():
            self._throw(self._stage.standing[chunk])
        for part in self._stage.moving:
            self._throw(part)
        self._context.polygon_offset = (0.0, 0.0)

    def _throw(self, part: DrawCall) -> None:
        self._context.polygon_offset = OFFSET if part.is_open else (0.0, 0.0)
        part.shadow.render(instances=part.instances)


def _cropped(clip_from_world: Floats, rectangle: Rectangle) -> Floats:
    """Return the projection through a rectangle of a map only."""
    left, low, right, high = (2 * edge / TEXELS - 1 for edge in rectangle)
    cropped = clip_from_world.copy()
    cropped[2] = 0  # nothing is too near to a light
    for row, (least, most) in enumerate(((left, right), (low, high))):
        cropped[row] = (2 * cropped[row] - (most + least) * cropped[3]) / (most - least)
    return cropped
