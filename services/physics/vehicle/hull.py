# SPDX-License-Identifier: Apache-2.0
"""The convex hull of a mesh that moves, as few points as the engine can be quick with.

Rule: pure, and the same text for the same mesh. The hull is spanned by those vertices that are
farthest in evenly spread directions; what is hollow is filled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DIRECTIONS = 64
"""More points than twice that make a contact no better, only slower."""


def hull(vertices: NDArray[np.float32]) -> str:
    """Return Wavefront OBJ text of which the engine makes the convex hull.

    Parameters
    ----------
    vertices
        shape (V, 3), m.
    """
    # Points on a sphere along a spiral whose turns are a golden angle apart.
    steps = np.arange(DIRECTIONS) + 0.5
    height = 1 - 2 * steps / DIRECTIONS
    turn = np.pi * (1 + np.sqrt(5)) * steps
    level = np.sqrt(1 - height**2)
    directions = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=-1)
    # Also along the axes, so that the hull is as long, wide and high as the mesh.
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    farthest = np.unique(np.argmax(vertices.astype(np.float64) @ directions.T, axis=0))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices[farthest].tolist()]
    # A fan, since a file without faces has no points to the engine.
    lines += [f"f 1 {i} {i + 1}" for i in range(2, len(farthest))]
    return "\n".join(lines) + "\n"
