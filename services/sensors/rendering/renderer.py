# SPDX-License-Identifier: Apache-2.0
"""Pictures of the world around a sensor, through a pinhole.

Rule: the same poses give the same bits, whatever was drawn before, for one driver's version. A
renderer has one context, current while it draws, and one size of picture; who wants several points
of view (two eyes, the poses during an exposure) draws several times.
"""

from __future__ import annotations

import weakref

import moderngl
import numpy as np
from numpy.typing import NDArray

from groundlink.frames import Floats
from groundlink.scenario.schema import World
from groundlink.world.terrain import BODY, ground

from .context import filtered, open_context
from .culling import from_near_to_far, seen
from .ground import DrawnGround
from .labels import Labels
from .lights import lighting
from .mesh import Mesh, Skin
from .pinhole import Pinhole
from .programs import BASE, SHADOWS, programs
from .shadows import ShadowMaps
from .stage import Part, Stage, Things
from .target import Frame, Target
from .uniforms import put, put_matrix


class Renderer:
    """Draws what a pinhole camera sees.

    Parameters
    ----------
    world : World
        Gives materials, light and fog.
    around : Things
        What there is to see.
    pinhole : Pinhole
    with_labels : bool
        Whether frames say which thing is at each pixel.

    Raises
    ------
    RenderingUnavailableError
        when OpenGL is missing here or does not draw (a `UserError`).

    Attributes
    ----------
    labels : Labels
        What the numbers in frames stand for.
    exposure : float
        Factor of all light; 1 suits the world's own light.
    close : callable
        Gives the context back; done at the latest when nobody holds the renderer any more.
    """

    def __init__(
        self, world: World, around: Things, pinhole: Pinhole, *, with_labels: bool = False
    ) -> None:
        context = self._context = open_context()
        self.close = weakref.finalize(self, context.release)
        context.front_face = "cw"  # pictures have their first row on top
        light = lighting(world, around.static)
        terrain = world.terrain and ground(world.terrain)
        kinds = len(terrain.materials) if terrain else 0
        self._programs = programs(context, light, with_labels=with_labels, ground=kinds)
        self._sky = context.vertex_array(self._programs.sky, [])
        self.labels = Labels(
            {solid.name for solid in world.solids},
            {actor.name: actor.kind for actor in world.actors},
        )
        self._stage = Stage(context, self._programs, around, world.materials, self.labels)
        self._ground: DrawnGround | None = None
        if terrain and self._programs.ground:
            number, *_ = self.labels.of_solids([BODY])
            self._ground = DrawnGround(
                context, self._programs.ground, terrain, world.materials, light, number
            )
        self._shadows = ShadowMaps(context, self._stage, self._programs.shadow, light)
        self._textures: dict[Skin, list[moderngl.Texture]] = {}
        self._pinhole = pinhole
        self._target = Target(context, pinhole.width, pinhole.height, with_labels=with_labels)
        self.exposure = 1.0

    @property
    def mended(self) -> int:
        """Rectangles of shadow maps that were drawn anew so far, because something had moved."""
        return self._shadows.mended

    def add(self, mesh: Mesh) -> None:
        """Stand a mesh in the world that no solid is made of, in the world's frame."""
        with self._context:
            self._stage.add(mesh)
        self._shadows.forget()

    def place(self, world_from_link: Floats) -> None:
        """Put every link of the surroundings at a pose, shape (links, 7)."""
        with self._context:
            self._stage.place(world_from_link)

    def draw(self, world_from_optical: Floats) -> Frame:
        """Return what is seen from a pose, shape (4, 4), with all links where they were placed."""
        with self._context:
            return self._drawn(world_from_optical)

    def _drawn(self, world_from_optical: Floats) -> Frame:
        eye, world_from_turned = world_from_optical[:3, 3], world_from_optical[:3, :3]
        clip_from_turned = self._pinhole.clip_from_optical()
        clip_from_turned[:, :3] @= world_from_turned.T
        clip_from_world = clip_from_turned.copy()
        clip_from_world[:, 3] -= clip_from_turned[:, :3] @ eye
        self._shadows.update(eye)
        shift, scale = self._shadows.window_from_map()
        for program in self._programs.lit():
            put(program, "window_shift", shift)
            put(program, "window_scale", scale)
            put_matrix(program, "clip_from_turned", clip_from_turned)
            put(program, "eye", eye)
            put(program, "forward", world_from_turned[:, 2])
            put(program, "exposure", self.exposure)
        sky = self._programs.sky
        put_matrix(sky, "world_from_clip", world_from_turned @ self._pinhole.ray_from_clip())
        put(sky, "exposure", self.exposure)

        self._target.begin()
        # Far off, depths are coarse: of two that are alike, the one drawn first is the nearer one.
        self._context.depth_func = "<"
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self._shadows.texture.use(SHADOWS)
        for part in self._stage.moving:
            self._show(part)
        boxes = self._stage.boxes
        for number in from_near_to_far(boxes, seen(boxes, clip_from_world), eye):
            self._show(self._stage.standing[number])
        if self._ground:
            self._ground.draw(clip_from_world, eye, max(self._pinhole.fx, self._pinhole.fy))
        self._context.disable(moderngl.CULL_FACE)
        self._context.depth_func = "<="  # the sky is as far as an empty depth buffer
        self._sky.render(vertices=3)
        return self._target.read()

    def _show(self, part: Part) -> None:
        skin = part.skin
        if skin not in self._textures:
            pictures = [skin.base] if skin.normal is None else [skin.base, skin.normal]
            self._textures[skin] = [_texture(self._context, picture) for picture in pictures]
        for unit, texture in enumerate(self._textures[skin], BASE):
            texture.use(unit)
        part.surface.render(instances=part.instances)


def _texture(context: moderngl.Context, picture: NDArray[np.uint8]) -> moderngl.Texture:
    height, width = picture.shape[:2]
    components = picture.size // (height * width)
    texture = context.texture((width, height), components, picture.tobytes(), alignment=1)
    if components == 1:
        texture.swizzle = "RRR1"
    return filtered(context, texture)
