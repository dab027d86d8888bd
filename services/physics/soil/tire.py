# SPDX-License-Identifier: Apache-2.0
"""Inflated tire in soil: flat at its pressure where that carries it, else round as a rigid wheel.

Sources: Bekker; Wong, Theory of Ground Vehicles (2008), section 2.6. The flat part presses with the
pressure of inflation and that of the carcass. Where a rigid wheel would not sink so deep, the
ground is too soft to flatten the tire. Thrust is that of a track as long as the flat part.
"""

from typing import NamedTuple

import numpy as np

from groundlink.core.frames import Floats
from groundlink.world.solids import Soil

from .stress import depth, passive_force_npm, pressure, shear, slip_sinkage
from .wheel import SoilForces, wheel_forces, wheel_sinkage

NO_SLIP = 1e-9


class InflatedTire(NamedTuple):
    """Size and ground pressure of a tire."""

    radius_m: float
    width_m: float
    pressure_pa: float
    """Of inflation and carcass together."""


def flattens(soil: Soil, tire: InflatedTire, load_n: Floats, slip: Floats) -> Floats:
    """Return where (1 or 0) a tire is flat: at less depth than a rigid wheel, in untouched soil."""
    flat = depth(soil, tire.width_m, np.asarray(tire.pressure_pa), slip_sinkage(soil, slip))
    rigid = wheel_sinkage(soil, tire.radius_m, tire.width_m, load_n, slip)
    return np.asarray(flat < rigid, np.float64)


def flat_length_m(tire: InflatedTire, load_n: Floats) -> Floats:
    """Return the length of the flat part, which carries the load at the tire's pressure."""
    return load_n / (tire.width_m * tire.pressure_pa)


def tire_sinkage(
    soil: Soil, tire: InflatedTire, load_n: Floats, slip: Floats, rut_m: Floats | float = 0.0
) -> Floats:
    """Return the sinkage, m; of a flat tire in a rut at least the rut's depth."""
    load, s, rut = np.broadcast_arrays(load_n, slip, rut_m)
    flat = depth(soil, tire.width_m, np.asarray(tire.pressure_pa), slip_sinkage(soil, s))
    rigid = wheel_sinkage(soil, tire.radius_m, tire.width_m, load, s, rut)
    return np.where(flattens(soil, tire, load, s) > 0.0, np.maximum(flat, rut), rigid)


def tire_forces(
    soil: Soil,
    tire: InflatedTire,
    sinkage_m: Floats,
    load_n: Floats,
    slip: Floats,
    rut_m: Floats | float = 0.0,
) -> SoilForces:
    """Return the forces at a sinkage by `tire_sinkage`; the arrays broadcast against each other.

    The resistance of a flat tire is the work of compaction for each meter, from `rut_m` on.
    """
    z, load, s, rut = np.broadcast_arrays(sinkage_m, load_n, slip, rut_m)
    width, length = tire.width_m, flat_length_m(tire, load)
    loosened = slip_sinkage(soil, s)
    deepened = pressure(soil, width, z, loosened) * z - pressure(soil, width, rut, loosened) * rut
    flat_resistance = width / (soil.n + 1.0) * np.where(z > rut, deepened, 0.0)
    strength = width * length * shear(soil, np.asarray(tire.pressure_pa), np.asarray(np.inf))
    sheared = np.maximum(np.abs(s), NO_SLIP) * length / soil.shear_displacement_m
    flat_thrust = np.sign(s) * strength * (1.0 + np.expm1(-sheared) / sheared)
    flat = flattens(soil, tire, load, s) > 0.0
    rigid = wheel_forces(soil, tire.radius_m, width, z, s, rut)
    return SoilForces(
        load,
        np.where(flat, flat_thrust, rigid.thrust_n),
        np.where(flat, flat_resistance, rigid.resistance_n),
        np.where(flat, passive_force_npm(soil, z) * length, rigid.side_n),
    )
