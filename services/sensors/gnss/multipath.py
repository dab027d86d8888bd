# SPDX-License-Identifier: Apache-2.0
"""Multipath: signals reflected once by a wall, and the errors of range that they cause.

Walls are found by a ring of rays around the antenna. The image method gives the direction from
which a wall reflects each satellite's signal, and rays check that the wall extends to the point of
reflection and that the path from there to the satellite is free. The ground does not reflect, as
antennas suppress signals from below. Frequency and code are those of GPS L1 C/A for all satellites.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from services.sensors.rays.scene import Hits

from .sky import directions
from .spec import Multipath

SPEED_OF_LIGHT_MPS = 299_792_458.0
WAVELENGTH_M = SPEED_OF_LIGHT_MPS / 1575.42e6
CHIP_M = SPEED_OF_LIGHT_MPS / 1.023e6
"""Wavelength of the carrier L1 and length of a chip of the code C/A: IS-GPS-200, 3.3."""

RING = directions([(3.75 * i, (3.0, 15.0)[i % 2]) for i in range(96)])
LEAST_HITS = 2
"""Rays of the ring that hit a wall. A surface with one hit is too narrow to be a mirror."""

STEEP = 0.3
"""Largest vertical part of a wall's normal: walls are within 17 degrees of the vertical."""

GRAZING = 0.02
"""Smallest sine of the angle between a signal and a wall that reflects it."""

SAME_NORMAL, SAME_PLANE_M = 0.9995, 0.05
"""Hits with normals of at least this cosine, and planes within this distance, are of one wall."""

OFF_WALL_M = 0.01
"""Distance from a wall at which the path to the satellite begins."""

Cast = Callable[[Floats, Floats, float], Hits]
"""Origins, shape (3,) or (3, rays); directions, shape (3, rays); maximum range in meters."""


class Walls(NamedTuple):
    """Planes around an antenna."""

    normals: Floats
    """Shape (walls, 3): unit vectors towards the antenna's side."""

    distances_m: Floats
    """Shape (walls,): from the antenna."""


def walls_around(antenna: Floats, reach_m: float, cast: Cast) -> Walls:
    """Return the walls that the ring of rays hits."""
    hits = cast(antenna, RING, reach_m)
    struck = np.isfinite(hits.range_m)
    rays, normals = RING[:, struck].T, hits.normal_in_world[:, struck].T.astype(np.float64)
    cosines = np.einsum("ij,ij->i", rays, normals)
    normals = np.where(cosines > 0, -1.0, 1.0)[:, None] * normals
    distances = hits.range_m[struck] * np.abs(cosines)
    left = np.abs(normals[:, 2]) < STEEP
    found = []
    while left.any():
        first = int(np.argmax(left))
        same = left & (normals @ normals[first] > SAME_NORMAL)
        same &= np.abs(distances - distances[first]) < SAME_PLANE_M
        if np.count_nonzero(same) >= LEAST_HITS:
            found.append(first)
        left &= ~same
    return Walls(normals[found], distances[found])


def detours_m(
    antenna: Floats, towards: Floats, spec: Multipath, sky_m: float, cast: Cast
) -> Floats:
    """Return how much longer the shortest reflected path of each satellite is than the direct one.

    Infinite for satellites without a reflection.

    Parameters
    ----------
    antenna : shape (3,)
    towards : shape (3, satellites)
    sky_m
        Surfaces beyond this distance block no path.
    """
    shortest = np.full(towards.shape[1], np.inf)
    walls = walls_around(antenna, spec.reach_m, cast)
    sines = walls.normals @ towards
    wall, satellite = np.nonzero(sines > GRAZING)
    if not len(wall):
        return shortest
    normals, sine = walls.normals[wall].T, sines[wall, satellite]
    # The mirror image of the satellite; its ray meets the wall at the point of reflection.
    images = towards[:, satellite] - 2 * sine * normals
    lengths = walls.distances_m[wall] / sine
    met = np.abs(cast(antenna, images, spec.reach_m).range_m - lengths) < SAME_PLANE_M
    met &= images[2] > 0
    if not met.any():
        return shortest
    points = antenna[:, None] + lengths * images + OFF_WALL_M * normals
    free = np.isinf(cast(points[:, met], towards[:, satellite[met]], sky_m).range_m)
    detours = 2 * walls.distances_m[wall] * sine
    np.minimum.at(shortest, satellite[met][free], detours[met][free])
    return shortest


def range_errors_m(
    detours: Floats, direct: NDArray[np.bool_], spec: Multipath, *, by_carrier: bool
) -> Floats:
    """Return errors of ranges, shape (satellites,): zero without a reflection.

    A signal that arrives by its reflection alone is as late as its detour is long.

    Parameters
    ----------
    detours : shape (satellites,)
        Infinite without a reflection.
    direct
        Whether the direct signal is received.
    """
    errors = np.where(np.isfinite(detours), detours, 0.0)
    both = direct & np.isfinite(detours)
    of_both = carrier_errors_m if by_carrier else code_errors_m
    errors[both] = of_both(detours[both], spec)
    return errors


def code_errors_m(detours: Floats, spec: Multipath) -> Floats:
    """Return errors of pseudoranges where a reflected signal joins the direct one.

    A coherent delay-locked loop with a triangular correlation: the discriminator's zero shifts by
    the first of three lines that applies, whose envelope is that of Misra and Enge, "Global
    Positioning System", 2nd edition, section 10.6.

    Parameters
    ----------
    detours : shape (n,)
        Finite.
    """
    phasor = spec.amplitude * np.cos(2 * np.pi * detours / WAVELENGTH_M)
    chips, half = detours / CHIP_M, spec.correlator_chips / 2
    shifts = np.minimum(chips / (1 + phasor), (1 + half - chips) / (2 - phasor))
    errors: Floats = CHIP_M * phasor * np.clip(shifts, 0.0, half)
    return errors


def combined(detours: Floats, spec: Multipath) -> NDArray[np.complex128]:
    """Return the sum of direct and reflected carrier as complex numbers; the direct one is 1."""
    sums: NDArray[np.complex128] = 1 + spec.amplitude * np.exp(-2j * np.pi * detours / WAVELENGTH_M)
    return sums


def carrier_errors_m(detours: Floats, spec: Multipath) -> Floats:
    """Return errors of carrier phases where a reflected signal joins the direct one.

    Up to a quarter of the wavelength (Misra and Enge, the same section).
    """
    errors: Floats = -WAVELENGTH_M / (2 * np.pi) * np.angle(combined(detours, spec))
    return errors
