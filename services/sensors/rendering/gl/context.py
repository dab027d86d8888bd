# SPDX-License-Identifier: Apache-2.0
"""OpenGL contexts without a window, by EGL: on a GPU if present, else with Mesa on the CPU.

A test triangle detects drivers that would draw black pictures. This is the only module that opens a
context.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, TypeVar

from groundlink.core.errors import RequirementError
from groundlink.core.extras import needs

from .shaders import shader

if TYPE_CHECKING:
    import moderngl

    Picture = TypeVar("Picture", moderngl.Texture, moderngl.TextureArray)

PACKAGES = "libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"
"""Debian packages for rendering without a GPU. A GPU's driver provides its own."""

_ADVICE = f"install Debian's {PACKAGES}, or the GPU's own EGL driver"

ANISOTROPY = 8.0
"""Anisotropy on a GPU. On a CPU it costs several times as much as everything else."""

FEW_CORES = 2
"""Cores up to which Mesa draws in the thread that asks for it."""

_FRAGMENT = """#version 330
layout(location = 0) out vec4 color;
layout(location = 1) out float depth;
void main() { color = vec4(0.2, 0.4, 0.8, 1.0); depth = 1234.5; }
"""


class RenderingUnavailableError(RequirementError):
    """OpenGL 3.3 is missing, or it does not draw."""


def open_context() -> moderngl.Context:
    """Return a new context that has passed a drawing test.

    Raises
    ------
    RequirementError
        If moderngl is not installed.
    RenderingUnavailableError
        If EGL is missing, or a test triangle is not read back as drawn.
    """
    with needs("camera"):
        import moderngl

    # Without this, Mesa looks for a screen.
    os.environ.setdefault("EGL_PLATFORM", "surfaceless")
    # Mesa starts a thread per core. Where other processes need the cores, they only add switches.
    if len(os.sched_getaffinity(0)) <= FEW_CORES:
        os.environ.setdefault("LP_NUM_THREADS", "0")
    try:
        context = moderngl.create_context(require=330, standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # moderngl raises plain Exception
        reason = " ".join(str(error).split())
        raise RenderingUnavailableError(
            f"cameras need OpenGL 3.3 by EGL, which does not open here ({reason}); {_ADVICE}"
        ) from None
    if not _draws(context):
        renderer = context.info["GL_RENDERER"]
        context.release()
        raise RenderingUnavailableError(
            f"OpenGL opens here ({renderer}), but a test triangle does not come out right; "
            f"{_ADVICE}"
        )
    return context


def is_software(context: moderngl.Context) -> bool:
    """Return whether the CPU draws: Mesa's llvmpipe or softpipe."""
    return "pipe" in context.info["GL_RENDERER"]


def filtered(context: moderngl.Context, texture: Picture) -> Picture:
    """Add mipmaps and filters to a texture, and return it."""
    import moderngl

    texture.build_mipmaps()
    if is_software(context):
        texture.filter = moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR
    else:
        texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        texture.anisotropy = ANISOTROPY
    return texture


def _draws(context: moderngl.Context) -> bool:
    """Return whether a triangle that covers the picture is read back as drawn."""
    size = (8, 8)
    color, depth = context.texture(size, 3), context.texture(size, 1, dtype="f4")
    frame = context.framebuffer([color, depth])
    program = context.program(vertex_shader=shader("screen.vert"), fragment_shader=_FRAGMENT)
    frame.use()
    context.vertex_array(program, []).render(vertices=3)
    drawn = frame.read(components=3, alignment=1)
    far = memoryview(frame.read(components=1, attachment=1, dtype="f4")).cast("f")
    return drawn == bytes((51, 102, 204)) * 64 and far.tolist() == [1234.5] * 64
