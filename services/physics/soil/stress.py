# SPDX-License-Identifier: Apache-2.0
"""Stresses in soil: pressure over depth, shear stress over displacement, passive pressure.

Sources: Wong, Theory of Ground Vehicles (2008), chapter 2. Pressure by Bekker, unloading and
reloading by Wong, shear by Janosi and Hanamoto, slip-sinkage by Lyasko (Journal of Terramechanics
47, 2010). All functions take arrays that broadcast against each other.
"""

from math import pi, radians, tan

import numpy as np

from groundlink.core.frames import Floats
from groundlink.world.solids import Soil
from services.physics.dynamics.backend import GRAVITY_MPS2

SHALLOW_M = 1e-9
"""Depth below which nothing is divided by a depth."""


def slip_sinkage(soil: Soil, slip: Floats) -> Floats:
    """Return the sinkage of a plate at a slip over its sinkage without slip."""
    s = np.clip(np.abs(slip), 0.0, 1.0)
    return 1.0 + soil.slip_sinkage * ((1.0 + s) / (1.0 - s / 2) - 1.0)


def pressure(soil: Soil, width_m: float, depth_m: Floats, loosened: Floats | float = 1.0) -> Floats:
    """Return the pressure, Pa, that presses a plate of this width to a depth for the first time.

    Parameters
    ----------
    loosened
        factor of the sinkage by slip, see `slip_sinkage`.
    """
    return (soil.k_c / width_m + soil.k_phi) * (np.maximum(depth_m, 0.0) / loosened) ** soil.n


def depth(
    soil: Soil, width_m: float, pressure_pa: Floats, loosened: Floats | float = 1.0
) -> Floats:
    """Return the depth, m, of a plate under a pressure: the inverse of `pressure`."""
    return loosened * (pressure_pa / (soil.k_c / width_m + soil.k_phi)) ** (1.0 / soil.n)


def rebound(soil: Soil, depth_m: Floats, pressure_pa: Floats) -> Floats:
    """Return by how much, m, the soil rises when a pressure at a depth is taken away."""
    stiffness = soil.unloading_npm3 + soil.unloading_npm4 * depth_m
    risen = np.divide(
        pressure_pa, stiffness, out=np.zeros_like(pressure_pa + depth_m), where=stiffness > 0.0
    )
    return np.minimum(risen, depth_m)


def repeated(
    soil: Soil, width_m: float, depth_m: Floats, rut_m: Floats, loosened: Floats | float = 1.0
) -> Floats:
    """Return the pressure, Pa, at a depth in soil that was pressed down to `rut_m` before.

    Zero above the rebounded surface, elastic down to the former depth, and the first loading below.
    """
    first = pressure(soil, width_m, depth_m, loosened)
    before = pressure(soil, width_m, rut_m, loosened)
    risen = rebound(soil, rut_m, before)
    up = np.clip((rut_m - depth_m) / np.maximum(risen, SHALLOW_M), 0.0, 1.0)
    return np.where(depth_m >= rut_m, first, before * (1.0 - up))


def shear(soil: Soil, normal_pa: Floats, displacement_m: Floats) -> Floats:
    """Return the shear stress, Pa, at a displacement; it has the displacement's sign."""
    most = soil.cohesion_pa + normal_pa * tan(radians(soil.friction_angle_deg))
    used = -np.expm1(-np.abs(displacement_m) / soil.shear_displacement_m)
    return most * used * np.sign(displacement_m)


def passive_force_npm(soil: Soil, depth_m: Floats) -> Floats:
    """Return the force, N/m, of the soil on a vertical wall that is pushed against it.

    Rankine's passive earth pressure over the wall's depth: a wheel that moves sideways bulldozes.
    """
    flow = tan(pi / 4 + radians(soil.friction_angle_deg) / 2)
    weight = soil.density_kgpm3 * GRAVITY_MPS2
    return weight * depth_m**2 / 2 * flow**2 + 2 * soil.cohesion_pa * depth_m * flow
