# SPDX-License-Identifier: Apache-2.0
"""Signal reception: startup, outages, satellites hidden by solids, and reflected signals.

Reception depends only on the instant and on the current positions, not on earlier states; what a
receiver makes of interrupted signals is in `fix_state`. Signals are not refracted.
"""

from collections.abc import Sequence
from enum import IntEnum
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS, exact
from groundlink.core.frames import Floats
from groundlink.messages.base import State
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.rays.probe import RayProbe

from .geodesy import TangentPlane
from .multipath import combined, detours_m
from .sky import FixedSky, MovingSky
from .spec import Gnss, Multipath

SKY_M = 1000.0
"""Solids beyond this distance hide no satellite."""


class Path(IntEnum):
    """Path of a satellite's signal to the antenna."""

    NONE = 0
    DIRECT = 1
    REFLECTED = 2
    """By a wall only, while the direct path is blocked."""


class Signals(NamedTuple):
    """Signals of all satellites at an instant; each array has shape (..., satellites)."""

    towards: Floats
    """Unit vectors east, north, up."""

    path: NDArray[np.int64]
    """Values of `Path`."""

    detour_m: Floats
    """Detour of the reflected signal; infinite without one."""

    @classmethod
    def none(cls, satellites: int) -> "Signals":
        """Return those of satellites that are not above the horizon."""
        path = np.full(satellites, Path.NONE, np.int64)
        return cls(np.zeros((3, satellites)), path, np.full(satellites, np.inf))


class Reception:
    """Reception of one antenna.

    Attributes
    ----------
    sky : FixedSky or MovingSky

    Raises
    ------
    UserError
        when the satellites give no position.
    KernelsMissingError
        with `sky_view`, when the compiled loops are not installed.
    """

    def __init__(
        self, scenario: Scenario, vehicle: Vehicle, spec: Gnss, plane: TangentPlane
    ) -> None:
        self._startup_nanos = int(exact(spec.startup_s) * NANOS)
        self._outages = spec.outages
        self.sky = MovingSky(spec, plane) if spec.constellations else FixedSky(spec)
        self._least_sine = np.sin(np.radians(spec.elevation_mask_deg))
        self._probe = RayProbe(scenario, vehicle, spec.mount) if spec.sky_view else None
        self._multipath = spec.multipath

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

    def signals(self, sim_nanos: int, antenna_in_world: Floats) -> Signals:
        """Return the signals that reach the antenna, whose position has shape (3,)."""
        towards = self.sky.towards(sim_nanos, antenna_in_world)
        count = towards.shape[1]
        path, detour = np.full(count, Path.NONE, np.int64), np.full(count, np.inf)
        x, y, _ = antenna_in_world.tolist()
        if sim_nanos < self._startup_nanos or any(inside(x, y, area) for area in self._outages):
            return Signals(towards, path, detour)
        above = towards[2] > self._least_sine
        if self._probe is None or not above.any():
            path[above] = Path.DIRECT
            return Signals(towards, path, detour)
        cast = partial(self._probe.cast, sim_nanos)
        seen = towards[:, above]
        free = np.isinf(cast(antenna_in_world, seen, SKY_M).range_m)
        path[above] = np.where(free, Path.DIRECT, Path.NONE)
        if self._multipath is not None:
            detour[above] = detours_m(antenna_in_world, seen, self._multipath, SKY_M, cast)
            path[(path == Path.NONE) & np.isfinite(detour)] = Path.REFLECTED
        return Signals(towards, path, detour)


HORIZON_DBHZ, ZENITH_DBHZ = 35.0, 50.0
"""C/N0 of a direct signal by elevation: an estimate of what a patch antenna under open sky has."""


def strengths_dbhz(signals: Signals, multipath: Multipath | None) -> Floats:
    """Return C/N0 of all satellites, shape (satellites,); 0 where nothing is received.

    A reflection strengthens or weakens the direct signal by its phase.
    """
    up = np.clip(signals.towards[2], 0.0, 1.0)
    strengths: Floats = HORIZON_DBHZ + (ZENITH_DBHZ - HORIZON_DBHZ) * up
    if multipath is not None:
        both = (signals.path == Path.DIRECT) & np.isfinite(signals.detour_m)
        strengths[both] += 20 * np.log10(np.abs(combined(signals.detour_m[both], multipath)))
        strengths[signals.path == Path.REFLECTED] += 20 * np.log10(multipath.amplitude)
    strengths[signals.path == Path.NONE] = 0.0
    return strengths


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
