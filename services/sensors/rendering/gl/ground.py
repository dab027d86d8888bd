# SPDX-License-Identifier: Apache-2.0
"""Terrain on the graphics card.

Heights are stored once, as a texture. A picture needs one draw call for the patches that
`ground_levels` selects.
"""

from collections.abc import Mapping, Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats
from groundlink.world.ruts import RutGrid
from groundlink.world.solids import Material
from groundlink.world.terrain import Ground
from services.sensors.rendering.look.ground_paint import colors, sunlit
from services.sensors.rendering.look.lights import Lighting
from services.sensors.rendering.look.textures import period_m, texture

from .context import filtered
from .ground_levels import HALF_PIXEL, SIDE, Levels
from .ground_ruts import VERTEX, faces, pressed_ground
from .programs import CELLS, HEIGHTS, KINDS, PATTERNS, RUTTED, Pass, put, put_integers

MOST_PATCHES = 1024
"""Initial capacity in patches."""

QUARTERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))
"""Signs of x and y as seen from the eye. For each, the triangles of a patch are drawn from near to
far: at a distance the depth buffer can't separate hills that follow each other."""


class DrawnGround:
    """A drawn terrain.

    Raises
    ------
    UserError
        If the terrain is larger than OpenGL supports on this machine.
    """

    def __init__(
        self,
        context: moderngl.Context,
        passes: Sequence[Pass],
        ground: Ground,
        materials: Mapping[str, Material],
        light: Lighting,
        label: int,
    ) -> None:
        programs = [one.ground for one in passes if one.ground]
        self._programs, self._ground = programs, ground
        self._context = context
        self._sun = unit(np.array(light.lights[0].at[:3])) if light.is_sun else None
        self._levels = Levels(ground)
        rows, columns = ground.heights.shape
        most = int(context.info["GL_MAX_TEXTURE_SIZE"])
        if max(rows, columns) > most:
            raise UserError(
                f"terrain of {columns} x {rows} heights: OpenGL allows {most} a side here. "
                "Fix: enlarge its cells"
            )
        heights = context.texture((columns, rows), 1, ground.heights, dtype="f4")
        heights.filter = moderngl.NEAREST, moderngl.NEAREST
        looks = np.full((rows - 1, columns - 1, 4), 255, np.uint8)
        looks[..., :3] = colors(ground, materials)
        if light.is_sun:
            looks[..., 3] = sunlit(ground, np.array(light.lights[0].at[:3]))
        cells = filtered(context, context.texture((columns - 1, rows - 1), 4, looks))
        cells.repeat_x = cells.repeat_y = False
        kinds = context.texture((columns - 1, rows - 1), 1, ground.surface, dtype="u1")
        kinds.filter = moderngl.NEAREST, moderngl.NEAREST
        self._textures: dict[int, moderngl.Texture | moderngl.TextureArray] = {
            HEIGHTS: heights,
            CELLS: cells,
            KINDS: kinds,
        }

        made_of = [materials[name] for name in ground.materials]
        names = list(dict.fromkeys(material.texture for material in made_of))
        pictures = np.stack([texture(name) for name in names])
        layers = context.texture_array((*pictures.shape[:0:-1], len(names)), 1, pictures)
        self._textures[PATTERNS] = filtered(context, layers)
        self._layers = [names.index(material.texture) for material in made_of]
        self._repeats_m = np.array([period_m(material) for material in made_of])

        knots, faces = _patch()
        vertices = context.buffer(knots.tobytes())
        middles = knots[faces].mean(axis=1)
        self._quarters: list[tuple[moderngl.Buffer, list[moderngl.VertexArray]]] = []
        for towards in QUARTERS:
            nearest_first = np.argsort(middles[:, :2] @ towards, kind="stable")
            patches = context.buffer(reserve=MOST_PATCHES * 3 * 4)
            content = [(vertices, "3i", "knot"), (patches, "3i /i", "patch_at")]
            indices = context.buffer(faces[nearest_first].tobytes())
            drawn = [
                context.vertex_array(program, content, indices, skip_errors=True)
                for program in programs
            ]
            self._quarters.append((patches, drawn))
        self._ruts = [one.ruts for one in passes if one.ruts]
        for program in (*programs, *self._ruts):
            put(program, "cell_m", ground.cell_m)
            put_integers(program, "label", label)
        self._grid: RutGrid | None = None
        self._cell_of_pressed: tuple[int, int] | None = None
        self._apart = (np.empty(0, np.intp),) * 2
        if self._ruts:
            mask = np.zeros((rows - 1, columns - 1), np.uint8)
            self._textures[RUTTED] = context.texture((columns - 1, rows - 1), 1, mask, dtype="u1")
            self._textures[RUTTED].filter = moderngl.NEAREST, moderngl.NEAREST

    def press(self, ruts: RutGrid) -> None:
        """Let the terrain have other ruts."""
        self._grid, self._cell_of_pressed = ruts, None

    def _refine(self, eye_cell: tuple[int, int]) -> None:
        """Make the mesh of the ruts around an eye, and leave its cells out of the terrain."""
        assert self._grid is not None
        made = pressed_ground(self._ground, self._grid, eye_cell, self._sun)
        self._cell_of_pressed, self._origin = eye_cell, made.origin_m
        mask = self._textures[RUTTED]
        assert isinstance(mask, moderngl.Texture)
        for rows, columns, is_apart in ((*self._apart, 0), (made.rows, made.columns, 1)):
            if not len(rows):
                continue
            south, west = int(rows.min()), int(columns.min())
            shape = int(rows.max()) - south + 1, int(columns.max()) - west + 1
            box = np.zeros(shape, np.uint8)
            box[rows - south, columns - west] = is_apart
            mask.write(box, (west, south, *shape[::-1]), alignment=1)
        self._apart = made.rows, made.columns
        vertices = self._context.buffer(made.vertices.tobytes() or bytes(VERTEX.itemsize))
        indices = faces(len(made.rows), self._grid.parts).tobytes() or bytes(12)
        triangles = self._context.buffer(indices)
        content = [(vertices, "3f 3f 1f", *VERTEX.names)]  # type: ignore[misc]
        self._pressed = [
            self._context.vertex_array(program, content, triangles, skip_errors=True)
            for program in self._ruts
        ]

    def _draw_ruts(self, number: int, eye: Floats) -> None:
        ground = self._ground
        row, column = np.floor((eye[1::-1] - (ground.y0_m, ground.x0_m)) / ground.cell_m).tolist()
        if self._cell_of_pressed != (eye_cell := (int(row), int(column))):
            self._refine(eye_cell)
        if len(self._apart[0]):
            put(self._ruts[number], "origin_from_eye", self._origin - eye)
            self._pressed[number].render()

    def draw(self, number: int, clip_from_world: Floats, eye: Floats, focal_px: float) -> None:
        """Draw the visible part of the terrain with the program of a pass.

        The uniforms of the view must be set.
        """
        ground, program = self._ground, self._programs[number]
        by_both = [program, *self._ruts[number : number + 1]]
        patches = self._levels.shown(clip_from_world, eye, focal_px)
        first = np.array([ground.x0_m, ground.y0_m])
        anchor = np.rint((eye[:2] - first) / ground.cell_m)
        put_integers(program, "anchor", anchor)
        put(program, "anchor_from_eye", first + anchor * ground.cell_m - eye[:2])
        extent = ground.cell_m * (np.array(ground.heights.shape[::-1]) - 1)
        cells_at = np.concatenate([(eye[:2] - first) / extent, 1 / extent])
        put(program, "pixel", 2 * HALF_PIXEL / focal_px)
        # Position of the eye in each pattern: pattern coordinates stay small near the eye, wherever
        # it is.
        within = np.mod(eye[:2] / self._repeats_m[:, None], 1)
        patterns_at = np.column_stack([self._layers, 1 / self._repeats_m, within])
        for each in by_both:
            put(each, "cells_at", cells_at)
            put(each, "patterns_at", patterns_at)
        for unit, picture in self._textures.items():
            picture.use(unit)
        if self._grid is not None:
            self._draw_ruts(number, eye)
        middles = patches[:, :2] + SIDE / 2 * patches[:, 2:]
        quarter = (middles >= (eye[:2] - first) / ground.cell_m) @ (2, 1)
        for which, (buffer, drawn) in enumerate(self._quarters):
            here = patches[quarter == which]
            if here.nbytes > buffer.size:
                buffer.orphan(2 * here.nbytes)
            buffer.write(here.tobytes())
            drawn[number].render(instances=len(here))


def unit(vector: Floats) -> Floats:
    """Return a vector's direction."""
    direction: Floats = vector / np.linalg.norm(vector)
    return direction


def _patch() -> tuple[NDArray[np.int32], NDArray[np.uint32]]:
    """Return a patch's vertices, shape (V, 3), and faces, shape (F, 3).

    A vertex is column, row, and 1 if lowered. A skirt surrounds the cells: the vertices of the rim
    once more, lowered.
    """
    side = SIDE + 1
    row, column = np.indices((side, side))
    level = np.stack([column, row, np.zeros_like(row)], axis=-1).reshape(-1, 3)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    faces = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (d, c, b))]
    # Counterclockwise along the rim, seen from above.
    rim = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    hem = len(level) + np.arange(len(rim))
    on_rim, on_hem = np.roll(rim, -1), np.roll(hem, -1)
    faces += [np.stack([rim, hem, on_hem], axis=-1), np.stack([rim, on_hem, on_rim], axis=-1)]
    knots = np.concatenate([level, level[rim] + (0, 0, 1)])
    return knots.astype(np.int32), np.concatenate(faces).astype(np.uint32)
