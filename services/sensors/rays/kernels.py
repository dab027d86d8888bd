# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over rays and pixels, written in C.

Functions take addresses of C-contiguous arrays. Each has one caller, which ensures types and shapes
and documents the computation.
"""

import ctypes
import importlib.util
from ctypes import c_double, c_float, c_int32, c_size_t, c_void_p
from functools import cache
from typing import Any

from groundlink.core.errors import UserError

_NAME = "services.sensors.rays._kernels"

_SIGNATURES: dict[str, tuple[Any, ...]] = {
    # Result, then arguments.
    "groundlink_trace": (None, c_void_p, c_size_t, c_float, *[c_void_p] * 7),
    "groundlink_tree": (None, c_void_p, c_int32, c_int32, c_void_p, c_void_p),
    "groundlink_ways": (None, c_void_p, c_int32, c_int32, *[c_void_p] * 3),
    "groundlink_sweep": (
        *(None, c_void_p, c_void_p, c_size_t, c_double),
        *(c_size_t, c_size_t, *[c_void_p] * 4),
    ),
    "groundlink_spread": (
        *(None, c_void_p, c_size_t, c_size_t, *[c_void_p] * 5),
        *(c_size_t, *[c_void_p] * 5),
    ),
    "groundlink_normals": (None, *[c_void_p] * 3, c_size_t, c_void_p),
    "groundlink_returns": (None, *[c_void_p] * 3, c_size_t, c_size_t, *[c_void_p] * 6),
    "groundlink_cover": (None, c_void_p, c_void_p),
    "groundlink_crc64": (None, c_void_p, c_size_t, c_size_t),
    "groundlink_grain": (None, c_size_t, *[c_void_p] * 4),
    "groundlink_points": (None, *[c_size_t] * 6, *[c_void_p] * 11),
}


class KernelsMissingError(UserError):
    """Setup found no C compiler."""


@cache
def kernels() -> ctypes.CDLL:
    """Return the compiled functions.

    Raises
    ------
    KernelsMissingError
        when they were not compiled.
    """
    found = importlib.util.find_spec(_NAME)
    if found is None or found.origin is None:
        raise KernelsMissingError(
            f"sensors with rays or pixel noise need {_NAME}, which is missing: Groundlink was "
            "installed without a C compiler. Fix: install gcc or clang, then install Groundlink "
            "again"
        )
    library = ctypes.CDLL(found.origin)
    for name, (result, *arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library
