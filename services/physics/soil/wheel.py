# SPDX-License-Identifier: Apache-2.0
"""Rigid wheel in soil: stresses along its rim by Wong and Reece, and the forces they add up to.

Source: Wong and Reece, Prediction of rigid wheel performance based on the analysis of soil-wheel
stresses, Journal of Terramechanics 4 (1967). From the entry angle to the angle of the largest
radial stress the soil is pressed down; from there to the exit angle the stress falls as it rose.
"""

from typing import NamedTuple

import numpy as np

from groundlink.core.frames import Floats
from groundlink.world.solids import Soil

from .stress import passive_force_npm, pressure, rebound, repeated, shear, slip_sinkage

DEEPEST = 0.95
"""Largest depth below the soil's present surface in radii: there the theory has no meaning left."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Of the integrals over each of the two parts of the rim, from -1 to 1."""

SOLVING = 24
"""Steps of the search for a sinkage; six are usual."""

CLOSE = 1e-6
"""Share of the load within which the search ends."""

LOCKED = 1e-6
"""Least ratio of the rim's speed to the hub's: a locked wheel shears without limit."""


class SoilForces(NamedTuple):
    """Forces of the soil on a wheel that rolls forward, N."""

    load_n: Floats
    """Upward."""

    thrust_n: Floats
    """Torque on the axle over the radius."""

    resistance_n: Floats
    """What the thrust loses until it pulls: drawbar pull is thrust minus resistance."""

    side_n: Floats
    """Passive pressure on the wheel's side, beyond the shear under it."""

    @property
    def drawbar_n(self) -> Floats:
        """Drawbar pull."""
        return self.thrust_n - self.resistance_n


def wheel_forces(
    soil: Soil,
    radius_m: float,
    width_m: float,
    sinkage_m: Floats,
    slip: Floats,
    rut_m: Floats | float = 0.0,
) -> SoilForces:
    """Return the forces at a sinkage; the arrays broadcast against each other.

    Parameters
    ----------
    sinkage_m
        depth of the wheel's lowest point below the untouched surface.
    slip
        of a driven wheel 1 - v / (r w), of a braked wheel (r w) / v - 1; from -1 to 1.
    rut_m
        depth to which a wheel before has pressed the soil; 0 for untouched soil.
    """
    z, s, rut = (a[..., None] for a in np.broadcast_arrays(sinkage_m, slip, rut_m))
    loosened = slip_sinkage(soil, s)
    surface = rut - rebound(soil, rut, pressure(soil, width_m, rut, loosened))
    entry = np.arccos(1.0 - np.clip(z - surface, 0.0, DEEPEST * radius_m) / radius_m)
    lowest = repeated(soil, width_m, z, rut, loosened)
    rising = rebound(soil, np.maximum(z, rut), lowest)
    leave = -np.arccos(1.0 - np.clip(rising, 0.0, DEEPEST * radius_m) / radius_m)
    # Soil flows where it is pressed down for the first time; where it rebounds the largest
    # stress is at the lowest point.
    flowing = np.arccos(1.0 - np.clip(z - rut, 0.0, DEEPEST * radius_m) / radius_m)
    most = (soil.stress_angle + soil.stress_angle_by_slip * np.abs(s)) * flowing

    front, rear = (entry - most) / 2, (most - leave) / 2
    angle = np.concatenate((most + front * (NODES + 1), leave + rear * (NODES + 1)), axis=-1)
    # A place on the rear part has the stress of the place as far along the front part.
    loading = np.concatenate((most + front * (NODES + 1), entry - front * (NODES + 1)), axis=-1)
    steps = np.concatenate((front * WEIGHTS, rear * WEIGHTS), axis=-1)

    normal = repeated(soil, width_m, z - radius_m * (1.0 - np.cos(loading)), rut, loosened)
    hub = np.where(s >= 0.0, 1.0 - s, 1.0 / np.maximum(1.0 + s, LOCKED))
    sheared = radius_m * (entry - angle - hub * (np.sin(entry) - np.sin(angle)))
    tangential = shear(soil, normal, sheared)

    def along_rim(stress: Floats) -> Floats:
        total: Floats = radius_m * width_m * np.sum(stress * steps, axis=-1)
        return total

    thrust = along_rim(tangential)
    pull = along_rim(tangential * np.cos(angle) - normal * np.sin(angle))
    ahead = entry / 2 * (NODES + 1)
    depths = np.maximum(z - surface - radius_m * (1.0 - np.cos(ahead)), 0.0)
    wall = passive_force_npm(soil, depths) * radius_m * np.cos(ahead)
    side: Floats = np.sum(wall * entry / 2 * WEIGHTS, axis=-1)
    load = along_rim(normal * np.cos(angle) + tangential * np.sin(angle))
    return SoilForces(load, thrust, thrust - pull, side)


def wheel_sinkage(
    soil: Soil,
    radius_m: float,
    width_m: float,
    load_n: Floats,
    slip: Floats,
    rut_m: Floats | float = 0.0,
) -> Floats:
    """Return the sinkage, m, at which the soil carries a load; at most `DEEPEST` radii.

    Load over depth is nearly a power law, so the secant method on logarithms finds it.
    """
    load, s, rut = np.broadcast_arrays(load_n, slip, rut_m)
    loosened = slip_sinkage(soil, s)
    surface = rut - rebound(soil, rut, pressure(soil, width_m, rut, loosened))
    low, high = np.log(1e-9 * radius_m), np.log(DEEPEST * radius_m)

    def excess(log_depth: Floats) -> Floats:
        z = surface + np.exp(log_depth)
        carried = wheel_forces(soil, radius_m, width_m, z, s, rut).load_n
        too_much: Floats = np.log(np.maximum(carried, 1e-12)) - np.log(load)
        return too_much

    # The first guess is Bekker's for a towed wheel.
    modulus = (soil.k_c / width_m + soil.k_phi) * width_m * np.sqrt(2 * radius_m)
    guess = 3 * load / ((3 - soil.n) * modulus)
    before = np.clip(np.log(guess) / (soil.n + 0.5), low, high)
    now = np.clip(before - 0.05, low, high)
    f_before, f_now = excess(before), excess(now)
    for _ in range(SOLVING):
        if np.all((np.abs(f_now) < CLOSE) | (now == high)):
            break
        change = f_now - f_before
        step = np.where(
            np.abs(change) > 1e-12,
            -f_now * (now - before) / np.where(change == 0.0, 1.0, change),
            0.0,
        )
        before, f_before = now, f_now
        now = np.clip(now + np.clip(step, -2.0, 2.0), low, high)
        f_now = excess(now)
    found: Floats = surface + np.exp(now)
    return found
