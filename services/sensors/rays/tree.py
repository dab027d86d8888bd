# SPDX-License-Identifier: Apache-2.0
"""Bounding volume trees, built by `tree.c` and traversed by the other loops in C."""

import numpy as np
from numpy.typing import NDArray

from .kernels import kernels

_NODE_BYTES = 32


class BoxTree:
    """A tree of boxes.

    Parameters
    ----------
    boxes : float32 array, shape (N, 2, 3)
        Lowest and highest corner of each.
    leaf_items : int
        Most boxes of a leaf.

    Attributes
    ----------
    nodes : uint8 array
        Structures `node` of `rays.h`.
    order : int32 array, shape (N,)
        Numbers of the boxes, leaf after leaf.
    """

    def __init__(self, boxes: NDArray[np.float32], *, leaf_items: int) -> None:
        self.nodes = np.empty((2 * len(boxes), _NODE_BYTES), np.uint8)
        self.order = np.empty(len(boxes), np.int32)
        if len(boxes):
            boxes = np.ascontiguousarray(boxes, np.float32)
            kernels().groundlink_tree(
                *(boxes.ctypes.data, len(boxes), leaf_items),
                *(self.order.ctypes.data, self.nodes.ctypes.data),
            )
