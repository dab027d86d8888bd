# SPDX-License-Identifier: Apache-2.0
"""Section of a track around one road wheel in soil: peak pressure, shear, compaction.

Sources: Rowland, Tracked vehicle ground pressure and its effect on soft ground performance (ISTVS
1972), for the mean maximum pressure under road wheels; Wong, Theory of Ground Vehicles (2008),
section 2.5, for the shear displacement along a track and the work of compaction.
"""

from typing import NamedTuple

import numpy as np

from groundlink.core.frames import Floats
from groundlink.world.solids import Soil

from .stress import depth, passive_force_npm, pressure, shear, slip_sinkage
from .wheel import DEEPEST, SoilForces

ROWLAND = 1.26
"""Mean maximum pressure over load by width by the square root of pitch times wheel diameter."""

NO_SLIP = 1e-9


class TrackSection(NamedTuple):
    """The part of a track that one road wheel presses down."""

    width_m: float
    length_m: float
    """Length of the track on the ground that belongs to this wheel."""

    ahead_m: float
    """Length of the track on the ground before this part, in the direction of travel."""

    wheel_diameter_m: float
    pitch_m: float
    """Length of a link."""


def peak_pressure(track: TrackSection, load_n: Floats) -> Floats:
    """Return Rowland's mean maximum pressure, Pa, under a road wheel."""
    across: float = track.width_m * np.sqrt(track.pitch_m * track.wheel_diameter_m)
    return ROWLAND * load_n / across


def track_sinkage(
    soil: Soil,
    track: TrackSection,
    load_n: Floats,
    slip: Floats,
    rut_m: Floats | float = 0.0,
) -> Floats:
    """Return the sinkage, m: in a rut at least the rut's depth, at most `DEEPEST` wheel radii."""
    fresh = depth(soil, track.width_m, peak_pressure(track, load_n), slip_sinkage(soil, slip))
    return np.minimum(np.maximum(fresh, rut_m), DEEPEST * track.wheel_diameter_m / 2)


def track_forces(
    soil: Soil,
    track: TrackSection,
    load_n: Floats,
    slip: Floats,
    rut_m: Floats | float = 0.0,
) -> SoilForces:
    """Return the forces on the section; the arrays broadcast against each other.

    Soil under a track is sheared by the slip times the way from where the track meets the ground.
    The resistance is the work that deepens the soil from `rut_m` on, for each meter.
    """
    z, load, s, rut = np.broadcast_arrays(
        track_sinkage(soil, track, load_n, slip, rut_m), load_n, slip, rut_m
    )
    loosened = slip_sinkage(soil, s)
    resistance = (
        track.width_m
        / (soil.n + 1.0)
        * (
            pressure(soil, track.width_m, z, loosened) * z
            - pressure(soil, track.width_m, rut, loosened) * rut
        )
    )
    area = track.width_m * track.length_m
    strength = area * shear(soil, load / area, np.full_like(load, np.inf))
    k, way = soil.shear_displacement_m, np.maximum(np.abs(s), NO_SLIP)
    # Mean over the section of exp(-s x / K).
    unused = np.exp(-way * track.ahead_m / k) * -np.expm1(-way * track.length_m / k)
    thrust = np.sign(s) * strength * (1.0 - unused * k / (way * track.length_m))
    side = passive_force_npm(soil, z) * track.length_m
    return SoilForces(load, thrust, resistance, side)
