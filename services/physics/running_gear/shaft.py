# SPDX-License-Identifier: Apache-2.0
"""Shaft: wheels that turn together, their motor and the grip of their tires.

Solved implicitly, so that neither a light wheel nor a stiff tread makes it oscillate. A motor holds
its target speed within its torque. `shaft.c` computes it.
"""

from collections.abc import Sequence
from ctypes import POINTER, Structure, byref, c_double, c_size_t
from math import nan

from services.physics.dynamics.bodies import pointers
from services.physics.dynamics.kernels import kernels

from .tire import Tire


class TurningShaft(Structure):
    """One shaft.

    Parameters
    ----------
    tires
        of its wheels.
    radius_m
        ratio of the treads' speed to the shaft's.
    inertia_kgm2
        of all turning parts, seen from the shaft.
    damping_nmsprad
        of its bearings, seen from the shaft.
    """

    MEMORY = ("angle_rad", "speed_radps", "tread_mps", "torque_nm")

    _fields_ = (
        ("_radius", c_double),
        ("inertia_kgm2", c_double),
        ("_damping", c_double),
        ("_tires", POINTER(POINTER(Tire))),
        ("_tire_count", c_size_t),
        ("asked_radps", c_double),
        ("asked_nm", c_double),
        ("angle_rad", c_double),
        ("speed_radps", c_double),
        ("tread_mps", c_double),
        ("torque_nm", c_double),
        ("_taken", c_double),
    )
    inertia_kgm2: float
    asked_radps: float
    """Target speed."""

    asked_nm: float
    """The largest torque toward the target speed; NaN for that of the motor."""

    angle_rad: float
    speed_radps: float
    tread_mps: float
    torque_nm: float
    """Of the motor in the last tick."""

    def __init__(
        self, tires: Sequence[Tire], *, radius_m: float, inertia_kgm2: float, damping_nmsprad: float
    ) -> None:
        self.tires = tuple(tires)
        self._pointers = pointers(self.tires)
        super().__init__(
            radius_m, inertia_kgm2, damping_nmsprad, self._pointers, len(tires), asked_nm=nan
        )

    def roll(self, tread_mps: float) -> None:
        """Set the speed to that of treads, whose deflections are gone."""
        self.tread_mps = tread_mps
        self.speed_radps = tread_mps / self._radius
        for tire in self.tires:
            tire.lift()

    def turn(self, asked_radps: float, least_nm: float, most_nm: float) -> None:
        """Advance by a tick toward a target speed, within torque limits."""
        self.asked_radps = asked_radps
        kernels().shaft_turn(byref(self), least_nm, most_nm)
