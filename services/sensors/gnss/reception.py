# SPDX-License-Identifier: Apache-2.0
"""Whether a receiver has a fix, and what of the sky it sees: its start, outages, and solids.

Rule: a function of the instant and of where everything stands, without a memory: what is seen again
is received at once.
"""

from __future__ import annotations

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
"""Solids farther away hide no satellite."""


class Reception:
    """What one antenna receives.

    Attributes
    ----------
    open_sky : Geometry
        That of all satellites.

    Raises
    ------
    UserError
        when the satellites give no position.
    KernelsMissingError
        with `sky_view`, when the compiled loops are not installed here.
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
        """Remember where everything is at the next tick.

        Raises
        ------
        BadBusMessage
            when a vehicle or a link is missing that could hide a satellite.
        """
        if self._probe is not None:
            self._probe.take(state)

    def view(self, sim_nanos: int, antenna_in_world: Floats) -> sky.Geometry | None:
        """Return what is received at an instant and a place, shape (3,); None without a fix."""
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
    """Tell whether a point is within a polygon, by how often a ray along x crosses its edges."""
    crossed = False
    ax, ay = polygon[-1]
    for bx, by in polygon:
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            crossed = not crossed
        ax, ay = bx, by
    return crossed
