# SPDX-License-Identifier: Apache-2.0
"""Embree called from C, one ray or eight rays after the other: `raw.c`, compiled with -O3."""

import ctypes
import subprocess
from ctypes import c_char_p, c_float, c_size_t, c_uint, c_void_p
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats, transform
from groundlink.world.triangles import Triangles, joined
from services.sensors.rays import embree
from services.sensors.rays.engine import aligned
from services.sensors.rays.scene import Reals

SOURCE = Path(__file__).with_name("raw.c")


class RawEmbree:
    """The terrain and the bodies, which share one mesh, on their way through a revolution."""

    def __init__(
        self, folder: Path, terrain: Triangles, body: Triangles, world_from_body: Floats
    ) -> None:
        library = folder / "raw.so"
        subprocess.run(["cc", "-O3", "-shared", "-fPIC", "-o", library, SOURCE, "-ldl"], check=True)
        matrices = np.swapaxes(
            transform(world_from_body[..., :3], world_from_body[..., 3:]), -1, -2
        )
        steps, bodies = world_from_body.shape[:2]
        self._kept = [
            _kept(array)
            for array in (terrain.vertices, terrain.faces, body.vertices, body.faces, matrices)
        ]
        self._kept.append(aligned((bodies,), np.uint32))
        vertices, faces, body_vertices, body_faces, places, zeros = (
            c_void_p(array.ctypes.data) for array in self._kept
        )
        self._ranges: Reals = np.empty(0, np.float32)
        self._raw = ctypes.CDLL(str(library))
        self._raw.raw_trace.argtypes = (c_size_t, c_float, *[c_void_p] * 4)
        error = self._raw.raw_build(
            *(c_char_p(embree.library()._name.encode()), c_void_p(embree.device().handle)),
            *(vertices, c_size_t(len(terrain.vertices)), faces, c_size_t(len(terrain.faces))),
            *(body_vertices, c_size_t(len(body.vertices)), body_faces, c_size_t(len(body.faces))),
            *(places, c_uint(steps), c_size_t(bodies), zeros),
        )
        _check(error)
        at_rest = joined(
            terrain,
            *(
                _placed(body, matrix)
                for matrix in transform(world_from_body[0, :, :3], world_from_body[0, :, 3:])
            ),
        )
        rest = [_kept(array) for array in (at_rest.vertices, at_rest.faces)]
        self._kept += rest
        self._raw.raw_trace_rest.argtypes = (c_size_t, c_float, *[c_void_p] * 3)
        sizes = (
            part for array in rest for part in (c_void_p(array.ctypes.data), c_size_t(len(array)))
        )
        _check(self._raw.raw_build_rest(*sizes))

    def move(self) -> None:
        """Take the bodies' motion, as after every revolution."""
        self._raw.raw_move()

    def cast(self, origins: Reals, directions: Reals, times: Reals, max_range_m: float) -> Reals:
        """Return the ranges of rays, which are as `Scene.cast` takes them, and contiguous."""
        ranges = self._ranges_of(times.shape)
        arrays = origins, directions, times, ranges
        self._raw.raw_trace(times.size, max_range_m, *(array.ctypes.data for array in arrays))
        return ranges

    def cast_at_rest(self, origins: Reals, directions: Reals, max_range_m: float) -> Reals:
        """Return the ranges of rays in the world as it is at first; there are whole eights."""
        ranges = self._ranges_of(origins[0].shape)
        arrays = origins, directions, ranges
        self._raw.raw_trace_rest(ranges.size, max_range_m, *(array.ctypes.data for array in arrays))
        return ranges

    def _ranges_of(self, shape: tuple[int, ...]) -> Reals:
        if self._ranges.shape != shape:
            self._ranges = np.empty(shape, np.float32)
        return self._ranges


def _placed(mesh: Triangles, matrix: Floats) -> Triangles:
    """Return a mesh whose frame is at a place, a 4 x 4 matrix."""
    vertices = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
    return Triangles(vertices.astype(np.float32), mesh.faces, mesh.labels)


def _check(error: int) -> None:
    if error:
        raise RuntimeError(f"Embree reports error {error}")


def _kept(array: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return a copy that Embree may read in place; reals are made float32."""
    copy = aligned(array.shape, np.uint32 if array.dtype.kind == "u" else np.float32)
    copy[...] = array
    return copy
