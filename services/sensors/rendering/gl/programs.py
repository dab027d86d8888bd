# SPDX-License-Identifier: Apache-2.0
"""Shader programs: how all of them are built, and the sources of sky and shadows.

Squares and square roots approximate the sRGB curve: 2.0 is close to 2.2 and costs nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

import moderngl
import numpy as np

from services.sensors.rendering.look.lights import Lighting
from services.sensors.rendering.look.textures import BRIGHTEST

from . import ground_shader, surface_shader
from .uniforms import put, put_integers, put_matrix

BASE, BUMPS, SHADOWS, HEIGHTS, CELLS, KINDS, PATTERNS = range(7)
"""Texture units."""

LAMP_RADIUS_M = 0.2

SHARPER = -0.7
"""Bias of the mipmap level for patterns of the ground. The camera looks along the ground, while
mipmap levels assume a perpendicular view."""

DEVELOPED = """
vec3 developed(vec3 light) {
    // Dark stays dark and lights do not burn out: Narkowicz 2015, "ACES Filmic Tone Mapping Curve".
    vec3 c = light * exposure;
    return sqrt(min(c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14), 1.0));
}
"""

SKY_VERTEX = """
uniform mat3 world_from_clip;
out vec3 ray;

void main() {
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
    ray = world_from_clip * vec3(corner, 1.0);
    gl_Position = vec4(corner, 1.0, 1.0);
}
"""

SKY_FRAGMENT = """
uniform vec3 horizon;
uniform vec3 zenith;
uniform vec4 light_at[LIGHTS];
uniform vec3 light_power[LIGHTS];
uniform float exposure;
in vec3 ray;
#ifdef TRUTH
layout(location = 0) out float depth;
layout(location = 1) out int label;

void main() {
    depth = uintBitsToFloat(0x7F800000u);  // +infinity
    label = -1;
}
#else
layout(location = 0) out vec4 color;

DEVELOPED;

void main() {
    vec3 d = normalize(ray);
    vec3 c = mix(horizon, zenith, sqrt(clamp(d.z, 0.0, 1.0)));
#ifdef SUN
    float near = max(dot(d, light_at[0].xyz), 0.0);
    c += light_power[0] * (0.15 * pow(near, 60.0) + 20.0 * step(0.99996, near));
#endif
    color = vec4(developed(c), 1.0);
}
#endif
"""

SHADOW_VERTEX = """
uniform mat4 clip_from_world;
in vec3 position;
in mat4 world_from_link;

void main() { gl_Position = clip_from_world * world_from_link * vec4(position, 1.0); }
"""

SHADOW_FRAGMENT = """
void main() {}
"""


class Pass(NamedTuple):
    """The programs that draw everything once: its colors, or its depth and labels."""

    surface: moderngl.Program
    bumped: moderngl.Program
    """For meshes with normal maps."""

    sky: moderngl.Program
    ground: moderngl.Program | None
    """For terrain, if there is any."""

    def lit(self) -> list[moderngl.Program]:
        """Return the programs that draw surfaces."""
        return [self.surface, self.bumped, *([self.ground] if self.ground else [])]


class Programs(NamedTuple):
    """All programs of one renderer."""

    passes: tuple[Pass, ...]
    shadow: moderngl.Program


class Options(NamedTuple):
    """Compile options of a renderer's programs."""

    lights: int
    sun: bool
    """Whether the lights are the sun; otherwise lamps."""

    window: bool
    """Whether there is a shadow map around the eye."""

    fog: bool

    def source(self, text: str, *, truth: int = 0, bumps: int = 0, ground: int = 0) -> str:
        """Return the source of a shader; `ground` is the number of a terrain's materials."""
        switches = {"SUN": self.sun, "WINDOW": self.window, "FOG": self.fog}
        switches |= {"TRUTH": bool(truth), "BUMPS": bool(bumps)}
        lines = ["#version 330", f"#define LIGHTS {self.lights}"]
        lines += [f"#define MAPS {self.lights + self.window}"]
        lines += [f"#define {name}" for name, on in switches.items() if on]
        lines += [f"#define GROUND {ground}"] if ground else []
        lines += [f"#define BRIGHTEST {BRIGHTEST}", f"#define LAMP_RADIUS_M {LAMP_RADIUS_M}"]
        lines += [f"#define SHARPER {SHARPER}"]
        return "\n".join([*lines, text.replace("DEVELOPED;", DEVELOPED)])


def programs(
    context: moderngl.Context, light: Lighting, truths: Sequence[bool], *, ground: int = 0
) -> Programs:
    """Return the programs with their constant uniforms set.

    Parameters
    ----------
    truths
        For each pass, whether it draws depth and labels instead of colors.
    ground
        Number of the terrain's materials; 0 without terrain.
    """
    fog = light.extinction_per_m > 0
    wide = light.window_m is not None
    options = Options(len(light.lights), light.is_sun, wide, fog)

    def made(vertex: str, fragment: str, **switches: int) -> moderngl.Program:
        return context.program(
            vertex_shader=options.source(vertex, **switches),
            fragment_shader=options.source(fragment, **switches),
        )

    passes = tuple(
        Pass(
            surface=made(surface_shader.VERTEX, surface_shader.FRAGMENT, truth=truth),
            bumped=made(surface_shader.VERTEX, surface_shader.FRAGMENT, truth=truth, bumps=1),
            sky=made(SKY_VERTEX, SKY_FRAGMENT, truth=truth),
            ground=made(ground_shader.VERTEX, surface_shader.FRAGMENT, truth=truth, ground=ground)
            if ground
            else None,
        )
        for truth in truths
    )
    # From -1..1 to the texture coordinates 0..1.
    halved = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
    maps = [halved @ one.clip_from_world for one in light.lights]
    units = {
        **{"base": BASE, "bumps": BUMPS, "shadow_map": SHADOWS},
        **{"heights": HEIGHTS, "cells": CELLS, "kinds": KINDS, "patterns": PATTERNS},
    }
    for program in (program for one in passes for program in (*one.lit(), one.sky)):
        put_matrix(program, "shadow_from_world", maps)
        put(program, "light_at", [one.at for one in light.lights])
        put(program, "light_power", [one.power for one in light.lights])
        for name in ("ambient_above", "ambient_below", "horizon", "zenith"):
            put(program, name, getattr(light, name))
        put(program, "extinction", light.extinction_per_m)
        for name, unit in units.items():
            put_integers(program, name, unit)
    return Programs(passes, made(SHADOW_VERTEX, SHADOW_FRAGMENT))
