# SPDX-License-Identifier: Apache-2.0
"""Shader programs of a renderer, from the files in `shaders`."""

from collections.abc import Sequence
from typing import NamedTuple

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from services.sensors.rendering.look.lights import Lighting
from services.sensors.rendering.look.textures import BRIGHTEST

from .shaders import shader
from .target import FINER

BASE, BUMPS, SHADOWS, HEIGHTS, CELLS, KINDS, PATTERNS, RUTTED = range(8)
"""Texture units."""

SAMPLERS = ("base", "bumps", "shadow_map", "heights", "cells", "kinds", "patterns", "rutted")
"""Name of each texture unit's sampler."""


class Pass(NamedTuple):
    """The programs that draw everything once: its colors, or its depth and labels."""

    surface: moderngl.Program
    bumped: moderngl.Program
    """For meshes with normal maps."""

    sky: moderngl.Program
    """Draws the sky; if colors have several samples, it averages them, too."""

    ground: moderngl.Program | None
    """For terrain, if there is any."""

    ruts: moderngl.Program | None
    """For the ruts of soft terrain."""

    grass: moderngl.Program | None
    """For tall grass, if there is any."""

    def lit(self) -> list[moderngl.Program]:
        """Return the programs that draw surfaces."""
        of_terrain = (one for one in (self.ground, self.ruts, self.grass) if one)
        return [self.surface, self.bumped, *of_terrain]


class Programs(NamedTuple):
    """All programs of one renderer."""

    passes: tuple[Pass, ...]
    shadow: moderngl.Program


def programs(
    context: moderngl.Context,
    light: Lighting,
    truths: Sequence[bool],
    *,
    samples: int,
    ground: int = 0,
    soils: bool = False,
    ruts: bool = False,
    grass: bool = False,
) -> Programs:
    """Return the programs with their constant uniforms set.

    Parameters
    ----------
    truths
        For each pass, whether it draws depth and labels instead of colors.
    samples
        Color samples per pixel: a key of `FINER`.
    ground
        Number of the terrain's materials; 0 without terrain.
    soils
        Whether each of these materials has a label of its own.
    ruts
        Whether the terrain is soft.
    grass
        Whether tall grass grows on it.
    """
    lights, has_window = len(light.lights), light.window_m is not None
    defines = {
        "LIGHTS": lights,
        "MAPS": lights + has_window,
        "SUN": light.is_sun,
        "WINDOW": has_window,
        "FOG": light.extinction_per_m > 0,
        "BRIGHTEST": BRIGHTEST,
    }

    def made(vertex: str, fragment: str, **switches: int) -> moderngl.Program:
        return context.program(
            vertex_shader=shader(f"{vertex}.vert", **defines, **switches),
            fragment_shader=shader(f"{fragment}.frag", **defines, **switches),
        )

    passes = tuple(
        Pass(
            surface=made("surface", "surface", TRUTH=truth),
            bumped=made("surface", "surface", TRUTH=truth, BUMPS=True),
            sky=made("sky", "sky", TRUTH=truth)
            if truth or samples == 1
            else made("sky", "resolve", FINER=FINER[samples]),
            ground=made("ground", "surface", TRUTH=truth, GROUND=ground, SOILS=soils, RUTS=ruts)
            if ground
            else None,
            ruts=made("ruts", "surface", TRUTH=truth, GROUND=ground, SOILS=soils, PRESSED=True)
            if ruts
            else None,
            grass=made("grass", "surface", TRUTH=truth) if grass else None,
        )
        for truth in truths
    )
    # From -1..1 to the texture coordinates 0..1.
    halved = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
    maps = [halved @ one.clip_from_world for one in light.lights]
    for program in (program for one in passes for program in (*one.lit(), one.sky)):
        put_matrix(program, "shadow_from_world", maps)
        put(program, "light_at", [one.at for one in light.lights])
        put(program, "light_power", [one.power for one in light.lights])
        for name in ("ambient_above", "ambient_below", "horizon", "zenith"):
            put(program, name, getattr(light, name))
        put(program, "extinction", light.extinction_per_m)
        for unit, name in enumerate(SAMPLERS):
            put_integers(program, name, unit)
    return Programs(passes, made("shadow", "shadow"))


def put(program: moderngl.Program, name: str, values: ArrayLike) -> None:
    """Set a uniform of floats: a number, a vector or an array of them.

    A uniform that the compiler has removed as unused is skipped, as by the functions below.
    """
    _write(program, name, np.asarray(values, np.float32).tobytes())


def put_matrix(program: moderngl.Program, name: str, matrices: ArrayLike) -> None:
    """Set a uniform of matrices, shape (..., rows, columns); OpenGL stores them by columns."""
    put(program, name, np.swapaxes(np.asarray(matrices), -1, -2))


def put_integers(program: moderngl.Program, name: str, values: ArrayLike) -> None:
    """Set a uniform of integers; for a sampler it is the texture unit."""
    _write(program, name, np.asarray(values).astype(np.int32).tobytes())


def _write(program: moderngl.Program, name: str, content: bytes) -> None:
    if name in program:
        uniform = program[name]
        assert isinstance(uniform, moderngl.Uniform)
        uniform.write(content)
