# SPDX-License-Identifier: Apache-2.0
"""Set uniforms of shader programs.

A uniform that the compiler has removed as unused is skipped.
"""

import moderngl
import numpy as np
from numpy.typing import ArrayLike


def put(program: moderngl.Program, name: str, values: ArrayLike) -> None:
    """Set a uniform of floats: a number, a vector or an array of them."""
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
