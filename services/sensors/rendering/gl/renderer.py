# SPDX-License-Identifier: Apache-2.0
"""Renderer: pictures of the world around a sensor, through a pinhole camera.

The same poses give the same bits, whatever was drawn before, for one version of a driver. So a view
is returned again while nothing moves, as that of a vehicle at rest. A renderer has one context,
which is current while it draws, and one picture size. For several points of view (two eyes, the
poses during an exposure) draw several times.
"""

import weakref
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.scenario.schema import World
from groundlink.world.ruts import RutGrid
from groundlink.world.terrain import BODY, load_ground
from services.sensors.rendering.gl.pinhole import Pinhole
from services.sensors.rendering.look.labels import Labels
from services.sensors.rendering.look.lights import lighting
from services.sensors.rendering.look.mesh import Skin, SkinnedMesh
from services.sensors.rendering.look.water import surface

from .context import filtered, open_context
from .culling import from_near_to_far, seen
from .grass import DrawnGrass, PressedArea, pressed_by
from .ground import DrawnGround
from .programs import BASE, SHADOWS, programs, put, put_matrix
from .shadows import ShadowMaps
from .silhouettes import Silhouettes
from .stage import Stage, Things
from .target import ColorTarget, Frame, Layer, TruthTarget

MOST_HELD = 2
"""Views that are kept while nothing moves: those of a pair of eyes."""


class _Drawn(NamedTuple):
    """A view that was drawn."""

    frame: Frame
    clip_from_world: Floats


class Renderer:
    """Draw what a pinhole camera sees.

    Parameters
    ----------
    world : World
        Materials, light and fog.
    around : Things
        The visible objects.
    pinhole : Pinhole
    layers : collection of Layer
        Layers of a frame. One pass draws color, another one depth and labels.
    samples : int
        Color samples per pixel: 1, 4 or 16.

    Raises
    ------
    RenderingUnavailableError
        If OpenGL is missing or does not draw (a `UserError`).

    Attributes
    ----------
    labels : Labels
        Meaning of the label numbers in frames.
    exposure : float
        Factor of all light; 1 suits the world's own light.
    close : callable
        Release the context. Called at the latest when the renderer is garbage collected.
    """

    def __init__(
        self,
        world: World,
        around: Things,
        pinhole: Pinhole,
        *,
        layers: Collection[Layer] = ("color", "depth"),
        samples: int = 4,
    ) -> None:
        context = self._context = open_context()
        self.close = weakref.finalize(self, context.release)
        context.front_face = "cw"  # pictures have their first row at the top
        light = lighting(world, around.static)
        terrain = world.terrain and load_ground(world.terrain)
        kinds = len(terrain.materials) if terrain else 0
        size = pinhole.width, pinhole.height
        self._color = ColorTarget(context, *size, samples) if "color" in layers else None
        wants_labels = "labels" in layers
        self._truth = (
            TruthTarget(context, *size, labels=wants_labels)
            if "depth" in layers or wants_labels
            else None
        )
        self._targets = [target for target in (self._color, self._truth) if target]
        truths = [target.truth for target in self._targets]
        has_soils = "soils" in layers
        is_soft = world.terrain is not None and world.terrain.is_soft(world.materials)
        self._programs = programs(
            *(context, light, truths),
            samples=samples,
            ground=kinds,
            soils=has_soils,
            ruts=is_soft,
            grass=bool(world.grass),
        )
        self._skies = [context.vertex_array(one.sky, []) for one in self._programs.passes]
        self.labels = Labels(
            {solid.name for solid in world.solids},
            {actor.name: actor.kind for actor in world.actors},
        )
        self._stage = Stage(context, self._programs, around, world.materials, self.labels)
        self._ground: DrawnGround | None = None
        self._grass: DrawnGrass | None = None
        actors = {actor.name for actor in world.actors}
        self._vehicles = [mover not in actors for mover in dict.fromkeys(around.movers)]
        if terrain:
            number = (
                self.labels.of_soils(BODY, world.ground_materials)
                if has_soils
                else self.labels.of_solids([BODY])[0]
            )
            self._ground = DrawnGround(
                *(context, self._programs.passes, terrain, world.materials, light, number)
            )
            covers = [number + has_soils * i for i in range(kinds, len(world.ground_materials))]
            for area, label in zip(world.water, covers, strict=False):
                self._stage.add(surface(area, terrain, world.materials[area.material], label))
            if world.grass:
                of_grass = [one.grass for one in self._programs.passes if one.grass]
                grown = world.grass, world.materials, covers[len(world.water) :]
                self._grass = DrawnGrass(context, of_grass, terrain, *grown)
        self._around, self._materials = around, world.materials
        self._silhouettes: Silhouettes | None = None
        self._shadows = ShadowMaps(context, self._stage, self._programs.shadow, light)
        self._textures: dict[Skin, list[moderngl.Texture]] = {}
        self._pinhole = pinhole
        nothing = Frame(np.empty((0, 0, 3), np.uint8), np.empty((0, 0), np.float32), None)
        self._nothing = nothing
        self._placed: Floats = np.empty((0, 7))
        self._held: dict[tuple[bytes, float], _Drawn] = {}
        self._last = _Drawn(nothing, np.eye(4))
        self.exposure = 1.0

    @property
    def mended(self) -> int:
        """Number of shadow map rectangles redrawn so far because something moved."""
        return self._shadows.mended

    def add(self, mesh: SkinnedMesh) -> None:
        """Add a mesh that belongs to no solid, in the world's frame."""
        with self._context:
            self._stage.add(mesh)
        self._shadows.forget()
        self._held.clear()

    def place(self, world_from_link: Floats) -> None:
        """Set the pose of every link of the world, shape (links, 7)."""
        if np.array_equal(world_from_link, self._placed):
            return
        self._placed = world_from_link.copy()
        self._held.clear()
        with self._context:
            self._stage.place(world_from_link)

    def press(self, ruts: RutGrid) -> None:
        """Let the terrain have other ruts from now on."""
        assert self._ground
        self._ground.press(ruts)
        if self._grass:
            self._grass.press(ruts)
        self._held.clear()

    def draw(self, world_from_optical: Floats) -> Frame:
        """Return the view from a pose, shape (4, 4), with all links where they were placed."""
        view = world_from_optical.tobytes(), self.exposure
        if view not in self._held:
            while len(self._held) >= MOST_HELD:
                del self._held[next(iter(self._held))]
            with self._context:
                self._held[view] = self._drawn(world_from_optical)
        self._last = self._held[view]
        return self._last.frame

    def visible_shares(self, labels: Sequence[int]) -> list[float]:
        """Return which share of each object's pixels the view that was drawn last shows.

        The whole is what it would show if nothing were in front of the object. Objects must be
        visible, and the renderer must draw labels.
        """
        assert self._truth is not None
        with self._context:
            if self._silhouettes is None:
                self._silhouettes = Silhouettes(
                    *(self._context, self._stage, self._around, self._materials, self.labels),
                    target=self._truth,
                    number=len(self._skies) - 1,
                    sky=self._skies[-1],
                )
            frame, clip_from_world = self._last
            shown = frame.counts(len(self.labels.instances))
            return [
                float(shown[label] / self._silhouettes.covered(label, clip_from_world))
                for label in labels
            ]

    def _drawn(self, world_from_optical: Floats) -> _Drawn:
        eye, world_from_turned = world_from_optical[:3, 3], world_from_optical[:3, :3]
        clip_from_turned = self._pinhole.clip_from_optical()
        clip_from_turned[:, :3] @= world_from_turned.T
        clip_from_world = clip_from_turned.copy()
        clip_from_world[:, 3] -= clip_from_turned[:, :3] @ eye
        if self._color:
            self._shadows.update(eye)
        shift, scale = self._shadows.window_from_map()
        for program in (program for one in self._programs.passes for program in one.lit()):
            put(program, "window_shift", shift)
            put(program, "window_scale", scale)
            put_matrix(program, "clip_from_turned", clip_from_turned)
            put(program, "eye", eye)
            put(program, "forward", world_from_turned[:, 2])
            put(program, "exposure", self.exposure)
        for sky in (one.sky for one in self._programs.passes):
            put_matrix(sky, "world_from_clip", world_from_turned @ self._pinhole.ray_from_clip())
            put(sky, "exposure", self.exposure)

        boxes = self._stage.boxes
        shown = from_near_to_far(boxes, seen(boxes, clip_from_world), eye)
        parts = [*self._stage.moving, *(self._stage.standing[number] for number in shown)]
        if self._grass:
            self._grass.aim(clip_from_world, eye, self._pressed())
        self._shadows.texture.use(SHADOWS)
        for number, target in enumerate(self._targets):
            target.begin()
            # Depth is coarse far away: of two equal depths, the first drawn surface is the nearer
            # one.
            self._context.depth_func = "<"
            self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
            for part in parts:
                if not target.truth:
                    self._put_on(part.skin)
                part.surfaces[number].render(instances=part.instances)
            if self._ground:
                focal_px = max(self._pinhole.fx, self._pinhole.fy)
                self._ground.draw(number, clip_from_world, eye, focal_px)
            self._context.disable(moderngl.CULL_FACE)
            if self._grass:
                if not target.truth:
                    self._put_on(self._grass.skin)
                self._grass.draw(number)
            self._context.depth_func = "<="  # the sky has the depth of an empty buffer
            target.end(self._skies[number])
        frame = self._nothing
        if self._color:
            frame = replace(frame, color=self._color.read())
        if self._truth:
            depth_m, labels = self._truth.read()
            frame = replace(frame, depth_m=depth_m, labels=labels)
        return _Drawn(frame, clip_from_world)

    def _pressed(self) -> list[PressedArea]:
        """Return the areas of the vehicles, which bend the grass under them."""
        return [
            pressed_by(outline)
            for outline, is_vehicle in zip(self._stage.movers, self._vehicles, strict=True)
            if is_vehicle and len(outline.poses)
        ]

    def _put_on(self, skin: Skin) -> None:
        if skin not in self._textures:
            pictures = [skin.base] if skin.normal is None else [skin.base, skin.normal]
            self._textures[skin] = [_texture(self._context, picture) for picture in pictures]
        for unit, texture in enumerate(self._textures[skin], BASE):
            texture.use(unit)


def _texture(context: moderngl.Context, picture: NDArray[np.uint8]) -> moderngl.Texture:
    height, width = picture.shape[:2]
    components = picture.size // (height * width)
    texture = context.texture((width, height), components, picture.tobytes(), alignment=1)
    if components == 1:
        texture.swizzle = "RRR1"
    return filtered(context, texture)
