# SPDX-License-Identifier: Apache-2.0
"""Satellite reception: startup, outages, satellites hidden by solids, dilution of precision.

Reception depends only on the instant and on the current positions, not on earlier states. A
satellite that becomes visible is received at once. Satellites do not move. Signals are
neither refracted nor reflected, so tall walls hide satellites but cause no multipath.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS, exact
from groundlink.core.errors import UserError
from groundlink.core.frames import Floats
from groundlink.messages.base import State
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.rays.probe import RayProbe

from .spec import Gnss

WORST_CONDITION = 1e6
"""Condition number of the normal matrix. Above it, satellites lie on a line or a cone and give no
position."""


class Geometry(NamedTuple):
    """Geometry of the visible satellites."""

    satellites: int
    dilution_enu: tuple[float, float, float]
    """Standard deviation of east, north and up, for range errors with a standard deviation of 1."""

    @property
    def horizontal_dilution(self) -> float:
        """Horizontal dilution of precision (HDOP)."""
        east, north, _ = self.dilution_enu
        return float(np.hypot(east, north))


def directions(satellites_deg: Sequence[tuple[float, float]]) -> Floats:
    """Return unit vectors east, north, up, shape (3, satellites), from azimuths and elevations."""
    azimuths, elevations = np.radians(np.array(satellites_deg, np.float64).reshape(-1, 2)).T
    across = np.cos(elevations)
    return np.stack([across * np.sin(azimuths), across * np.cos(azimuths), np.sin(elevations)])


def geometry(towards: Floats, visible: NDArray[np.bool_]) -> Geometry | None:
    """Return the geometry of the visible satellites; None if they give no position.

    Position and receiver clock are estimated by least squares with equal weights. The covariance is
    the inverse of H^T H, with one row (east, north, up, 1) per satellite (Misra and Enge, "Global
    Positioning System", 2nd edition, section 6.1.2).

    Parameters
    ----------
    towards : shape (3, satellites)
    visible : shape (satellites,)
    """
    seen = towards[:, visible]
    rows = np.vstack([seen, np.ones(seen.shape[1])]).T
    normal = rows.T @ rows
    if len(rows) < 4 or np.linalg.cond(normal) > WORST_CONDITION:
        return None
    east, north, up, _ = np.sqrt(np.diag(np.linalg.inv(normal))).tolist()
    return Geometry(len(rows), (east, north, up))


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


SKY_M = 1000.0
"""Solids beyond this distance hide no satellite."""


class Reception:
    """Reception of one antenna.

    Attributes
    ----------
    open_sky : Geometry
        Geometry of all satellites.

    Raises
    ------
    UserError
        when the satellites give no position.
    KernelsMissingError
        with `sky_view`, when the compiled loops are not installed.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Gnss) -> None:
        self._startup_nanos = int(exact(spec.startup_s) * NANOS)
        self._outages = spec.outages
        self._needed = spec.satellites_needed
        self._towards = directions(spec.satellites_deg)
        self.open_sky = open_sky(self._towards)
        self._probe = RayProbe(scenario, vehicle, spec.mount) if spec.sky_view else None

    def restart(self) -> None:
        """Forget all states."""
        if self._probe is not None:
            self._probe.restart()

    def take(self, state: State) -> None:
        """Store the pose of every link at the next tick.

        Raises
        ------
        BadBusMessage
            when a vehicle or a link that could hide a satellite is missing.
        """
        if self._probe is not None:
            self._probe.take(state)

    def view(self, sim_nanos: int, antenna_in_world: Floats) -> Geometry | None:
        """Return the geometry of the received satellites; None without a fix.

        The antenna's position has shape (3,).
        """
        if sim_nanos < self._startup_nanos:
            return None
        x, y, _ = antenna_in_world.tolist()
        if any(inside(x, y, polygon) for polygon in self._outages):
            return None
        if self._probe is None:
            return self.open_sky
        hits = self._probe.cast(sim_nanos, antenna_in_world, self._towards, SKY_M)
        visible = np.isinf(hits.range_m)
        if np.count_nonzero(visible) < self._needed:
            return None
        return geometry(self._towards, visible)


def inside(x: float, y: float, polygon: Sequence[tuple[float, float]]) -> bool:
    """Return whether a point is inside a polygon.

    An odd number of edges crosses the ray along x from the point.
    """
    crossed = False
    ax, ay = polygon[-1]
    for bx, by in polygon:
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            crossed = not crossed
        ax, ay = bx, by
    return crossed
