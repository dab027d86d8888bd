# SPDX-License-Identifier: Apache-2.0
"""Embree through ctypes: the part of its C interface that builds scenes.

Each class holds the handle of an Embree object and the memory that Embree reads in place. Names,
enumerators and layouts are those of Embree 4.4's `rtcore*.h`. The library comes with the `embreex`
wheel, so no system package is needed; the Python interface of embreex is not used.

Embree's instance arrays with motion blur are not used either: building them took 3 to 11 ms for a
revolution of 100 bodies through 41 poses, and their linearly interpolated matrices pull rotating
bodies toward their axis. `tracer.c` moves the rays instead.
"""

import ctypes
import importlib.util
import weakref
from ctypes import c_char_p, c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.core.errors import UserError

from .engine import SceneMeshes

SUPPORTED = (40400, 40500)
"""Versions up to but excluding the next minor one: layouts may change between minor versions."""

_GEOMETRY_TYPE_TRIANGLE = 0
_BUFFER_TYPE_INDEX, _BUFFER_TYPE_VERTEX = 0, 1
_FORMAT_UINT3, _FORMAT_FLOAT3 = 0x5003, 0x9003
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
            "the package `embreex` is not installed. Fix: pip install 'groundlink[sensors]'"
        )
    try:
        import embreex.rtcore_scene  # noqa: F401  (loads libembree4 and the libtbb that it needs)
    except ImportError as error:
        raise EngineUnavailableError(f"the package `embreex` does not load: {error}") from None

    folder = Path(spec.origin).parent.parent / "embreex.libs"
    found = sorted(folder.glob("libembree4*"))
    if not found:
        raise EngineUnavailableError(
            f"no libembree4 in {folder}; expected the one of embreex's Linux wheel"
        )
    loaded = ctypes.CDLL(str(found[0]))
    for name, (result, *arguments) in _SIGNATURES.items():
        function = getattr(loaded, name)
        function.restype, function.argtypes = result, arguments
    return loaded


class Device:
    """An Embree device, on one thread and with one instruction set.

    AVX2 everywhere and a single thread give the same bits on every x86-64 machine that has AVX2.
    """

    def __init__(self) -> None:
        self.handle = library().rtcNewDevice(b"threads=1,isa=avx2")
        if not self.handle:
            raise EngineUnavailableError("Embree does not start: it needs a CPU with AVX2")
        weakref.finalize(self, library().rtcReleaseDevice, self.handle)
        version = library().rtcGetDeviceProperty(self.handle, _DEVICE_PROPERTY_VERSION)
        if not SUPPORTED[0] <= version < SUPPORTED[1]:
            raise EngineUnavailableError(
                f"the installed embreex includes Embree {version // 10000}.{version // 100 % 100}."
                f"{version % 100}, expected 4.4. "
                "Fix: pip install 'groundlink[sensors]'"
            )

    def check(self) -> None:
        """Raise `EngineError` if a call since the last check failed."""
        code = library().rtcGetDeviceError(self.handle)
        if code:
            raise EngineError(f"Embree reports error {code}")


@cache
def device() -> Device:
    """Return the only device of this process.

    It is never released: Embree's worker threads may spin forever after that.
    """
    return Device()


class EmbreeMesh:
    """A static mesh in a scene of its own."""

    def __init__(
        self, device: Device, vertices: NDArray[np.float32], faces: NDArray[np.uint32]
    ) -> None:
        embree = library()
        self._kept = device, vertices, faces
        self.scene: int = embree.rtcNewScene(device.handle)
        weakref.finalize(self, embree.rtcReleaseScene, self.scene)
        # Robust: no ray passes through the edge between two triangles.
        embree.rtcSetSceneFlags(self.scene, _SCENE_FLAG_ROBUST)
        geometry = embree.rtcNewGeometry(device.handle, _GEOMETRY_TYPE_TRIANGLE)
        for buffer, layout, array in (
            (_BUFFER_TYPE_VERTEX, _FORMAT_FLOAT3, vertices),
            (_BUFFER_TYPE_INDEX, _FORMAT_UINT3, faces),
        ):
            embree.rtcSetSharedGeometryBuffer(
                *(geometry, buffer, 0, layout),
                *(array.ctypes.data, 0, array.strides[0], len(array)),
            )
        embree.rtcCommitGeometry(geometry)
        embree.rtcAttachGeometry(self.scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(self.scene)
        device.check()


class EmbreeEngine:
    """Implements `RayEngine` with Embree."""

    def __init__(self, meshes: SceneMeshes) -> None:
        self._meshes = [EmbreeMesh(device(), meshes.vertices, faces) for faces in meshes.each()]
        self.intersect = ctypes.cast(library().rtcIntersect8, c_void_p)
        self.scenes = [mesh.scene for mesh in self._meshes]
