# SPDX-License-Identifier: Apache-2.0
"""Rays in the layout that Embree traces, and the call that traces them.

Rule: this is the one place that is in a hurry. Memory is made once and filled again for each row;
a packet costs one call from C to C. What hits mean is the business of `scene`.
"""

from __future__ import annotations

import ctypes
from collections import deque
from ctypes import c_int, c_uint, c_void_p
from functools import cache
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .embree import Scene, aligned, library

PACKET = 8
"""Rays that are traced at once: as many as an AVX2 register holds.

Packets of 16, which Embree has to cut in two without AVX-512, took twice as long.
"""

ROWS = 21
"""Of an RTCRayHit8: each a row of 8 lanes of 4 bytes."""

# Rows of RTCRay8 and RTCHit8.
ORIGIN, DIRECTION, TIME = slice(0, 3), slice(4, 7), slice(7, 8)
FAR, MASK, GEOMETRY = 8, 9, 18
RANGE, NORMAL, IDS = slice(8, 9), slice(12, 15), slice(17, 21)
"""IDS: triangle, geometry in its scene, instance in the scene that was traced, body of an array."""

NO_HIT = -1
"""Geometry of a ray that met nothing; its other ids mean nothing then."""

_RAY_QUERY_FLAG_COHERENT = 1 << 16


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = (
        ("flags", c_int),
        ("feature_mask", c_uint),
        ("context", c_void_p),
        ("filter", c_void_p),
        ("intersect", c_void_p),
    )


_COHERENT = _Arguments(_RAY_QUERY_FLAG_COHERENT, 0xFFFFFFFF)


@cache
def _intersect() -> Any:
    """Return rtcIntersect8 as a function that keeps the interpreter's lock.

    A packet takes half a microsecond: to let go of the lock for each would cost more than it gives,
    and wait for whoever took it.
    """
    function = ctypes.PyDLL(library()._name).rtcIntersect8
    function.restype = None  # Without argtypes: arguments that are pointers already go unchecked.
    return function


class Packets:
    """A row of rays in the layout that Embree traces, 8 at once, and where they ended.

    Neighbours are traced together and should be alike. A row of some thousand rays stays in the
    processor's second cache from `put` to `get`; all rows of a revolution at once would not, and
    take half as long again.
    """

    def __init__(self, rays: int) -> None:
        self._whole, self._rest = divmod(rays, PACKET)
        packets = self._whole + bool(self._rest)
        self._memory = aligned((packets, ROWS, PACKET), np.float32)
        self._words = self._memory.view(np.int32)
        self._words[:, MASK] = -1  # Rays meet geometries of every mask.
        self._valid = aligned((PACKET,), np.int32)
        self._valid[:] = -1
        first, size = self._memory.ctypes.data, ROWS * PACKET * 4
        self._addresses = [c_void_p(first + size * packet) for packet in range(packets)]

    def put(self, fields: slice, values: NDArray[np.float32]) -> None:
        """Set some fields of every ray, shape (fields, rays)."""
        split = self._whole * PACKET
        tiles = values[:, :split].reshape(len(values), -1, PACKET)
        self._memory[: self._whole, fields] = tiles.swapaxes(0, 1)
        if self._rest:
            self._memory[-1, fields, : self._rest] = values[:, split:]

    def get(self, fields: slice, into: NDArray[np.float32] | NDArray[np.int32]) -> None:
        """Copy some fields of every ray, bit by bit, into an array of shape (fields, rays)."""
        memory, split = self._memory.view(into.dtype), self._whole * PACKET
        tiles = memory[: self._whole, fields].swapaxes(0, 1)
        into[:, :split] = tiles.reshape(len(into), split)
        if self._rest:
            into[:, split:] = memory[-1, fields, : self._rest]

    def trace(self, scene: Scene, max_range: float) -> None:
        """Follow every ray to its nearest hit, at most `max_range` times its direction's length."""
        self._words[:, GEOMETRY] = NO_HIT
        self._memory[:, FAR] = max_range
        if self._rest:
            self._memory[-1, FAR, self._rest :] = -np.inf  # Lanes without a ray do nothing.
        constants = self._valid.ctypes.data, scene.handle, ctypes.addressof(_COHERENT)
        valid, target, arguments = (repeat(c_void_p(constant)) for constant in constants)
        # A loop in C, `map` into an empty deque: one in Python takes half as long as Embree itself.
        deque(map(_intersect(), valid, target, self._addresses, arguments), maxlen=0)
