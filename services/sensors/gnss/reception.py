# SPDX-License-Identifier: Apache-2.0
"""Satellite reception: startup, outages, and satellites hidden by solids.

Reception depends only on the instant and on the current positions, not on earlier states. A
satellite that becomes visible is received at once.
"""

from collections.abc import Sequence

import numpy as np

from groundlink.core.clock import NANOS, exact
from groundlink.core.frames import Floats
from groundlink.messages.base import State
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import Gnss
from services.sensors.rays.probe import RayProbe

from . import sky

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
        self._towards = sky.directions(spec.satellites_deg)
        self.open_sky = sky.open_sky(self._towards)
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

    def view(self, sim_nanos: int, antenna_in_world: Floats) -> sky.Geometry | None:
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
        return sky.geometry(self._towards, visible)


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
