# SPDX-License-Identifier: Apache-2.0
"""How numbers get into shaders.

Rule: a uniform that the compiler has left out, as nothing depends on it, is passed over.
"""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import ArrayLike


def put(program: moderngl.Program, name: str, values: ArrayLike) -> None:
    """Set a uniform of floats: a number, a vector, an array of them."""
    _write(program, name, np.asarray(values, np.float32).tobytes())


def put_matrix(program: moderngl.Program, name: str, matrices: ArrayLike) -> None:
    """Set a uniform of matrices, shape (..., rows, columns); OpenGL goes by columns."""
    put(program, name, np.swapaxes(np.asarray(matrices), -1, -2))


def put_unit(program: moderngl.Program, name: str, unit: int) -> None:
    """Say at which unit a sampler finds its texture."""
    _write(program, name, np.int32(unit).tobytes())


def _write(program: moderngl.Program, name: str, content: bytes) -> None:
    if name in program:
        uniform = program[name]
        assert isinstance(uniform, moderngl.Uniform)
        uniform.write(content)
