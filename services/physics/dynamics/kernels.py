# SPDX-License-Identifier: Apache-2.0
"""Compiled functions of a tick, written in C: Bullet's calls, and the models of vehicles.

Functions take addresses of `ctypes` structures, of which the C code has the same. The class of a
structure documents its fields and calls the functions on it.
"""

import ctypes
import importlib.util
from ctypes import c_char_p, c_double, c_size_t, c_void_p
from functools import cache
from typing import Any

from groundlink.core.errors import RequirementError

_NAME = "services.physics.dynamics._kernels"

_SIGNATURES: dict[str, tuple[Any, ...]] = {
    # Result, then arguments.
    "bullet_bind": (c_char_p, c_void_p),
    "bullet_world": (c_void_p,),
    "bullet_step": (None, c_void_p),
    "bullet_sense": (None, c_void_p, c_void_p, c_size_t),
    "bullet_push": (None, c_void_p, c_void_p, c_size_t),
    "bullet_contacts": (None, c_void_p, c_void_p),
    "contacts_free": (None, c_void_p),
    "soil_table_at": (None, c_void_p, *[c_double] * 3, c_void_p),
    "tire_lift": (None, c_void_p),
    "tire_meet": (None, c_void_p, *[c_double] * 5),
    "tire_along": (None, c_void_p, c_double, c_void_p),
    "tire_settle": (None, c_void_p, c_double, c_void_p),
    "shaft_turn": (None, c_void_p, c_double, c_double),
    "motors_limits": (None, c_void_p, c_double, c_double, c_void_p),
    "motors_power": (c_double, c_void_p, c_double, c_double),
    "battery_draw": (c_double, c_void_p, c_double),
    "steering_joint_turn": (None, c_void_p, c_double, c_double),
    "vehicle_torques": (None, c_void_p, c_void_p),
    "vehicles_touch": (c_size_t, c_void_p, c_size_t, c_void_p, c_void_p),
    "vehicles_press": (None, c_void_p, c_size_t, c_void_p),
    "vehicles_roll": (None, c_void_p, c_size_t),
    "vehicles_spring": (None, c_void_p, c_size_t),
    "vehicles_sense": (None, c_void_p, c_size_t),
    "vehicles_write": (None, c_void_p, c_size_t),
}


@cache
def library_file() -> str:
    """Return the compiled library's file.

    Raises
    ------
    RequirementError
        when setup found no C compiler.
    """
    found = importlib.util.find_spec(_NAME)
    if found is None or found.origin is None:
        raise RequirementError(
            f"physics needs {_NAME}, which is missing: Groundlink was installed without a C "
            "compiler. Fix: install gcc or clang, then install Groundlink again"
        )
    return found.origin


class Kernels:
    """The functions, by their names in C without `groundlink_`."""

    def __init__(self) -> None:
        library = ctypes.CDLL(library_file())
        for name, (result, *arguments) in _SIGNATURES.items():
            function = getattr(library, f"groundlink_{name}")
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"no function of C is called `{name}`")


@cache
def kernels() -> Kernels:
    """Return the compiled functions; see `library_file` for errors."""
    return Kernels()
