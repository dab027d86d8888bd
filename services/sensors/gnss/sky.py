# SPDX-License-Identifier: Apache-2.0
"""Satellites over a world: directions that stand still, or circular orbits by sim time.

Orbits are those of a point mass: no flattening of the Earth, no Sun, Moon or maneuvers. Their time
is sim time, not the date, so a run sees the same sky on every day.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.core.frames import Floats

from .dilution import Geometry, geometry
from .geodesy import TangentPlane
from .spec import Gnss, Walker

GRAVITATION_M3PS2 = 3.986004418e14
"""GM of the Earth: NGA.STND.0036, WGS 84, table 3.1."""

EARTH_RATE_RADPS = 7.292115e-5
"""Angular velocity of the Earth: the same table."""

DAY_S, SAMPLE_S = 86_400, 600
"""The typical dilution is that of a day, sampled in these steps."""


class Satellite(NamedTuple):
    """Identity of a satellite."""

    system: str
    """As in `Walker.system`."""

    number: int
    """Number in its system, from 1."""


class Orbits:
    """Positions of the satellites of some constellations."""

    def __init__(self, constellations: Sequence[Walker]) -> None:
        self.satellites = tuple(
            Satellite(walker.system, 1 + i)
            for walker in constellations
            for i in range(walker.satellites)
        )
        elements = np.hstack([_elements(walker) for walker in constellations])
        self._radius, self._node, self._argument, inclination = elements
        self._motion = np.sqrt(GRAVITATION_M3PS2 / self._radius**3)
        self._sine, self._cosine = np.sin(inclination), np.cos(inclination)

    def ecef_m(self, seconds: float) -> Floats:
        """Return Earth-centered positions at a time, shape (3, satellites).

        Kepler's motion on a circle; the node moves west as the Earth turns (IS-GPS-200, table
        20-IV, without eccentricity and corrections).
        """
        argument = self._argument + self._motion * seconds
        node = self._node - EARTH_RATE_RADPS * seconds
        along, across = self._radius * np.cos(argument), self._radius * np.sin(argument)
        return np.stack([
            along * np.cos(node) - across * self._cosine * np.sin(node),
            along * np.sin(node) + across * self._cosine * np.cos(node),
            across * self._sine,
        ])  # fmt: skip


def _elements(walker: Walker) -> Floats:
    """Return radius (m), node, argument and inclination (rad) of a pattern, shape (4, satellites).

    Satellites are numbered plane by plane.
    """
    number = np.arange(walker.satellites)
    per_plane = walker.satellites // walker.planes
    plane, slot = np.divmod(number, per_plane)
    node = walker.node_deg + 360.0 / walker.planes * plane
    argument = walker.argument_deg + 360.0 * (
        slot / per_plane + walker.phasing * plane / walker.satellites
    )
    return np.stack([
        np.full(walker.satellites, walker.semi_major_axis_km * 1000.0),
        np.radians(node),
        np.radians(argument),
        np.full(walker.satellites, np.radians(walker.inclination_deg)),
    ])  # fmt: skip


def directions(satellites_deg: Sequence[tuple[float, float]]) -> Floats:
    """Return unit vectors east, north, up, shape (3, satellites), from azimuths and elevations."""
    azimuths, elevations = np.radians(np.array(satellites_deg, np.float64).reshape(-1, 2)).T
    across = np.cos(elevations)
    return np.stack([across * np.sin(azimuths), across * np.cos(azimuths), np.sin(elevations)])


def open_sky(towards: Floats) -> Geometry:
    """Return the geometry of all satellites.

    Raises
    ------
    UserError
        when the satellites give no position.
    """
    found = geometry(towards, np.ones(towards.shape[1], np.bool_))
    if found is None:
        raise UserError(
            "`satellites_deg`: these directions give no position even under open sky. Fix: "
            "spread them over the sky"
        )
    return found


class FixedSky:
    """Satellites that do not move.

    Attributes
    ----------
    satellites : tuple of Satellite
    typical_dilution_enu : Vector3
        Dilution under an open sky.

    Raises
    ------
    UserError
        when the satellites give no position.
    """

    def __init__(self, spec: Gnss) -> None:
        self._towards = directions(spec.satellites_deg)
        self.satellites = tuple(Satellite("gps", 1 + i) for i in range(self._towards.shape[1]))
        above = self._towards[2] > np.sin(np.radians(spec.elevation_mask_deg))
        self.typical_dilution_enu = open_sky(self._towards[:, above]).dilution_enu

    def towards(self, sim_nanos: int, antenna_in_world: Floats) -> Floats:
        """Return unit vectors east, north, up to all satellites, shape (3, satellites)."""
        return self._towards


class MovingSky:
    """Satellites on orbits; parameters and attributes as for `FixedSky`.

    The typical dilution is the root mean square of the constellations' first day under an open sky.
    """

    def __init__(self, spec: Gnss, plane: TangentPlane) -> None:
        self._orbits = Orbits(spec.constellations)
        self.satellites = self._orbits.satellites
        self._plane = plane
        self._enu_from_ecef = np.array([plane.turned(axis) for axis in _AXES])
        self._sky_time_s = spec.sky_time_s
        least = np.sin(np.radians(spec.elevation_mask_deg))
        samples = (self._directions(t, np.zeros(3)) for t in range(0, DAY_S, SAMPLE_S))
        found = [geometry(towards, towards[2] > least) for towards in samples]
        dilutions = np.array([each.dilution_enu for each in found if each is not None])
        if not len(dilutions):
            raise UserError(
                "`constellations`: these satellites give no position at any time of a day. Fix: "
                "add a constellation, or lower `elevation_mask_deg`"
            )
        east, north, up = np.sqrt(np.mean(dilutions**2, axis=0)).tolist()
        self.typical_dilution_enu = (east, north, up)

    def towards(self, sim_nanos: int, antenna_in_world: Floats) -> Floats:
        """Return unit vectors east, north, up to all satellites, shape (3, satellites)."""
        return self._directions(self._sky_time_s + sim_nanos / NANOS, antenna_in_world)

    def _directions(self, seconds: float, antenna_in_world: Floats) -> Floats:
        x, y, z = antenna_in_world.tolist()
        antenna = np.array(self._plane.ecef((x, y, z)))
        apart = self._orbits.ecef_m(seconds) - antenna[:, None]
        towards: Floats = self._enu_from_ecef @ (apart / np.linalg.norm(apart, axis=0))
        return towards


_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
