# SPDX-License-Identifier: Apache-2.0
"""What is drawn into, and the arrays in which pictures come back.

Rule: colour, depth and labels of one pass, in the same pixels; the top row first.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Frame:
    """One picture. The arrays are overwritten by the next one of the same renderer."""

    colour: NDArray[np.uint8]
    """Shape (height, width, 3): red, green, blue, gamma-coded."""

    depth_m: NDArray[np.float32]
    """Shape (height, width): along z of the optical frame; infinite in the sky."""

    labels: NDArray[np.int32] | None
    """Shape (height, width): numbers of `Renderer.labels`, -1 in the sky; None unless asked for."""


class Target:
    """Pictures of one size on the graphics card."""

    def __init__(
        self, context: moderngl.Context, width: int, height: int, *, with_labels: bool
    ) -> None:
        size, shape = (width, height), (height, width)
        layers = [context.texture(size, 3), context.texture(size, 1, dtype="f4")]
        if with_labels:
            layers.append(context.texture(size, 1, dtype="i4"))
        nearest = context.depth_renderbuffer(size)
        self._all = context.framebuffer(layers, nearest)
        self._nearest = context.framebuffer(depth_attachment=nearest)
        self._frame = Frame(
            np.empty((*shape, 3), np.uint8),
            np.empty(shape, np.float32),
            np.empty(shape, np.int32) if with_labels else None,
        )

    def begin(self) -> None:
        """Forget the last picture. Only of depth: the sky is drawn wherever nothing else is."""
        self._nearest.use()
        self._nearest.clear()
        self._all.use()

    def read(self) -> Frame:
        """Return what has been drawn."""
        frame = self._frame
        self._all.read_into(frame.colour, components=3, alignment=1)
        self._all.read_into(frame.depth_m, components=1, attachment=1, dtype="f4")
        if frame.labels is not None:
            self._all.read_into(frame.labels, components=1, attachment=2, dtype="i4")
        return frame
