# SPDX-License-Identifier: Apache-2.0
"""The part of Embree's C interface that builds scenes, through ctypes.

Rule: one thin class for each kind of Embree object, which keeps the handle, the memory that Embree
reads in place, and nothing else; whoever holds the Python object holds the Embree object. Names,
enumerators and layouts are those of Embree 4.4's `rtcore*.h`. The library is the one that the
`embreex` wheel carries, so no system package is needed; of embreex's own interface, which has
neither instances nor motion, nothing is used.
"""

from __future__ import annotations

import ctypes
import importlib.util
import weakref
from collections.abc import Iterable, Sequence
from ctypes import c_char_p, c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.errors import UserError

SUPPORTED = (40400, 40500)
"""Versions from the first with instance arrays as they are used here, up to but excluding the next
minor one: layouts may change between minor versions."""

_ALIGNMENT = 64
_PADDING_BYTES = 16
"""Embree may read this far past the last element of a buffer."""

_GEOMETRY_TYPE_TRIANGLE, _GEOMETRY_TYPE_INSTANCE, _GEOMETRY_TYPE_INSTANCE_ARRAY = 0, 121, 122
_BUFFER_TYPE_INDEX, _BUFFER_TYPE_VERTEX, _BUFFER_TYPE_TRANSFORM = 0, 1, 23
_FORMAT_UINT, _FORMAT_UINT3, _FORMAT_FLOAT3, _FORMAT_FLOAT4X4_COLUMN_MAJOR = (
    0x5001,
    0x5003,
    0x9003,
    0x9244,
)
_SCENE_FLAG_ROBUST = 1 << 2
_DEVICE_PROPERTY_VERSION = 0

_SIGNATURES: dict[str, tuple[Any, ...]] = {
    # Result, then arguments.
    "rtcNewDevice": (c_void_p, c_char_p),
    "rtcReleaseDevice": (None, c_void_p),
    "rtcGetDeviceError": (c_int, c_void_p),
    "rtcGetDeviceProperty": (c_ssize_t, c_void_p, c_int),
    "rtcNewScene": (c_void_p, c_void_p),
    "rtcSetSceneFlags": (None, c_void_p, c_int),
    "rtcCommitScene": (None, c_void_p),
    "rtcReleaseScene": (None, c_void_p),
    "rtcNewGeometry": (c_void_p, c_void_p, c_int),
    "rtcAttachGeometry": (c_uint, c_void_p, c_void_p),
    "rtcCommitGeometry": (None, c_void_p),
    "rtcReleaseGeometry": (None, c_void_p),
    "rtcSetGeometryInstancedScene": (None, c_void_p, c_void_p),
    "rtcSetGeometryInstancedScenes": (None, c_void_p, ctypes.POINTER(c_void_p), c_size_t),
    "rtcSetGeometryTimeStepCount": (None, c_void_p, c_uint),
    "rtcUpdateGeometryBuffer": (None, c_void_p, c_int, c_uint),
    "rtcSetSharedGeometryBuffer": (
        *(None, c_void_p, c_int, c_uint, c_int),
        *(c_void_p, c_size_t, c_size_t, c_size_t),
    ),
}


class EngineUnavailableError(UserError):
    """Embree is not installed, or is not the version that this binding was written for."""


class EngineError(RuntimeError):
    """Embree refused a call."""


@cache
def library() -> ctypes.CDLL:
    """Return the Embree library, its functions typed.

    Raises
    ------
    EngineUnavailableError
        when embreex is not installed or carries no libembree4.
    """
    spec = importlib.util.find_spec("embreex")
    if spec is None or spec.origin is None:
        raise EngineUnavailableError(
            "ray casting needs the package `embreex`, which is not installed here; "
            "install the extra `sensors`: pip install groundlink[sensors]"
        )
    import embreex.rtcore_scene  # noqa: F401  (loads libembree4 and the libtbb that it needs)

    folder = Path(spec.origin).parent.parent / "embreex.libs"
    found = sorted(folder.glob("libembree4*"))
    if not found:
        raise EngineUnavailableError(
            f"no libembree4 in {folder}; expected the one that the Linux wheel of embreex carries"
        )
    loaded = ctypes.CDLL(str(found[0]))
    for name, (result, *arguments) in _SIGNATURES.items():
        function = getattr(loaded, name)
        function.restype, function.argtypes = result, arguments
    return loaded


def intersect_function() -> c_void_p:
    """Return the address of rtcIntersect8, which traces 8 rays at once."""
    return ctypes.cast(library().rtcIntersect8, c_void_p)


def aligned(shape: Sequence[int], dtype: type[np.generic]) -> NDArray[Any]:
    """Return a zeroed array that starts on a cache line and may be read past its end."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.zeros(size + _PADDING_BYTES + _ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % _ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)


class Device:
    """Embree itself, on one thread and with one instruction set.

    AVX2 everywhere and a single thread give the same bits on every x86-64 machine that has AVX2.
    """

    def __init__(self) -> None:
        self.handle = library().rtcNewDevice(b"threads=1,isa=avx2")
        if not self.handle:
            raise EngineUnavailableError("Embree does not start here: it needs a CPU with AVX2")
        weakref.finalize(self, library().rtcReleaseDevice, self.handle)
        version = library().rtcGetDeviceProperty(self.handle, _DEVICE_PROPERTY_VERSION)
        if not SUPPORTED[0] <= version < SUPPORTED[1]:
            raise EngineUnavailableError(
                f"the installed embreex carries Embree {version // 10000}.{version // 100 % 100}."
                f"{version % 100}, expected 4.4; "
                "install the version that groundlink[sensors] names"
            )

    def check(self) -> None:
        """Raise `EngineError` if a call since the last check failed."""
        code = library().rtcGetDeviceError(self.handle)
        if code:
            raise EngineError(f"Embree reports error {code}")


class _Geometry:
    """A geometry of any kind, attached to scenes by handle."""

    def __init__(self, device: Device, kind: int) -> None:
        self.handle = library().rtcNewGeometry(device.handle, kind)
        weakref.finalize(self, library().rtcReleaseGeometry, self.handle)
        self._kept: dict[tuple[int, int], NDArray[Any]] = {}

    def share(self, buffer: int, slot: int, layout: int, array: NDArray[Any]) -> None:
        """Let Embree read rows of `array` in place; it must come from `aligned`."""
        self._kept[buffer, slot] = array
        library().rtcSetSharedGeometryBuffer(
            *(self.handle, buffer, slot, layout),
            *(array.ctypes.data, 0, array.strides[0], len(array)),
        )

    def commit(self) -> None:
        """Make changes count at the next commit of the scene."""
        library().rtcCommitGeometry(self.handle)


class Mesh(_Geometry):
    """Triangles at rest."""

    def __init__(
        self, device: Device, vertices: NDArray[np.float32], faces: NDArray[np.uint32]
    ) -> None:
        super().__init__(device, _GEOMETRY_TYPE_TRIANGLE)
        layouts = (
            (_BUFFER_TYPE_VERTEX, _FORMAT_FLOAT3, vertices, np.float32),
            (_BUFFER_TYPE_INDEX, _FORMAT_UINT3, faces, np.uint32),
        )
        for buffer, layout, values, dtype in layouts:
            array = aligned(values.shape, dtype)
            array[:] = values
            self.share(buffer, 0, layout, array)
        self.commit()


class Instance(_Geometry):
    """A scene inside another, in place."""

    def __init__(self, device: Device, scene: Scene) -> None:
        super().__init__(device, _GEOMETRY_TYPE_INSTANCE)
        self._scene = scene
        library().rtcSetGeometryInstancedScene(self.handle, scene.handle)
        self.commit()


class InstanceArray(_Geometry):
    """Scenes inside another, each at a pose that changes in linear steps of the ray's time."""

    def __init__(self, device: Device, scenes: Sequence[Scene]) -> None:
        super().__init__(device, _GEOMETRY_TYPE_INSTANCE_ARRAY)
        self._scenes = tuple(scenes)
        self._matrices: NDArray[np.float32] | None = None
        handles = (c_void_p * len(scenes))(*(scene.handle for scene in scenes))
        library().rtcSetGeometryInstancedScenes(self.handle, handles, len(scenes))
        index = aligned((len(scenes), 1), np.uint32)
        index[:, 0] = range(len(scenes))
        self.share(_BUFFER_TYPE_INDEX, 0, _FORMAT_UINT, index)

    def move(self, matrices: NDArray[np.float32]) -> None:
        """Take the poses at evenly spaced times from 0 to 1.

        Parameters
        ----------
        matrices : float32 array from `aligned`, shape (steps, bodies, 16)
            Homogeneous scene_from_body, column after column; the same array as before may have
            changed.
        """
        if matrices is self._matrices:
            for step in range(len(matrices)):
                library().rtcUpdateGeometryBuffer(self.handle, _BUFFER_TYPE_TRANSFORM, step)
        else:
            self._matrices = matrices
            library().rtcSetGeometryTimeStepCount(self.handle, len(matrices))
            for step, poses in enumerate(matrices):
                self.share(_BUFFER_TYPE_TRANSFORM, step, _FORMAT_FLOAT4X4_COLUMN_MAJOR, poses)
        self.commit()


class Scene:
    """Geometries that rays can meet; the number of each is its place in `geometries`."""

    def __init__(self, device: Device, geometries: Iterable[_Geometry]) -> None:
        self._device = device
        self.geometries = tuple(geometries)
        self.handle = library().rtcNewScene(device.handle)
        weakref.finalize(self, library().rtcReleaseScene, self.handle)
        # Robust: no ray slips through the edge between two triangles.
        library().rtcSetSceneFlags(self.handle, _SCENE_FLAG_ROBUST)
        for geometry in self.geometries:
            library().rtcAttachGeometry(self.handle, geometry.handle)
        self.commit()

    def commit(self) -> None:
        """Build what changed."""
        library().rtcCommitScene(self.handle)
        self._device.check()
