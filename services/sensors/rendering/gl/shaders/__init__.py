# SPDX-License-Identifier: Apache-2.0
"""GLSL files of all programs.

Expensive features of a shader are compiled in only where needed, by `#ifdef`.
"""

import re
from importlib.resources import files

VERSION = 330
"""Of GLSL, for OpenGL 3.3."""


def shader(name: str, **defines: float) -> str:
    """Return the source of a shader: its file with `#include` resolved, below `#define` lines.

    Parameters
    ----------
    defines
        Values of macros. A macro with the value False is not defined.
    """
    lines = [f"#define {macro} {+value}" for macro, value in defines.items() if value is not False]
    return "\n".join([f"#version {VERSION}", *lines, _file(name)])


def _file(name: str) -> str:
    text = files(__package__).joinpath(name).read_text(encoding="utf-8")
    return re.sub(r'#include "(.+)"', lambda included: _file(included[1]), text)
