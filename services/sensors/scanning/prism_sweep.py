# SPDX-License-Identifier: Apache-2.0
"""Sweep of two turning wedges of glass (a Risley pair): no two revolutions are alike.

A vertical fan of beams leaves the lasers ahead, along x. Each wedge has a flat face, across x, and
a slanted one. Beams enter the first wedge through its slanted face and leave the second through its
slanted face; the two flat faces between them, of the same glass, cancel. So Snell's law in vectors
acts twice. At the start of a run both wedges bend the beams to the right.

Source: Marshall 1999, "Risley prism scan patterns"; the order of the faces is that with which this
model meets a copy of the table of angles that Livox publishes for the Avia (`avia.yaml`).
"""

import numpy as np

from groundlink.core.frames import Floats
from groundlink.scenario.rotating_lidar import RotatingLidar, TurningPrisms

from .pattern_sweep import PatternSweep


class PrismSweep(PatternSweep):
    """The rays of a data sheet with prisms."""

    def __init__(self, spec: RotatingLidar, prisms: TurningPrisms) -> None:
        super().__init__(spec)
        self._prisms = prisms
        self.aim(0)

    def directions(self, seconds: Floats) -> Floats:
        """Return unit vectors of beams at instants of a run, shape (3, lasers, firings)."""
        first, second = self._prisms.turns_per_s
        index, wedge = self._prisms.refractive_index, np.radians(self._prisms.wedge_deg)
        none = np.zeros_like(self.offsets_rad)
        fan = np.stack([np.cos(self.offsets_rad), none, np.sin(self.offsets_rad)])
        inside = _refracted(fan, _normals(-wedge, first * seconds), 1 / index)
        return _refracted(inside, _normals(wedge, second * seconds), index)


def _normals(slant_rad: float, turns: Floats) -> Floats:
    """Return normals along the beams of a face that is slanted to the left and has turned."""
    turned = 2 * np.pi * (turns % 1)
    aside = np.sin(slant_rad)
    ahead = np.broadcast_to(np.cos(slant_rad), turned.shape)
    return np.stack([ahead, aside * np.cos(turned), aside * np.sin(turned)])


def _refracted(directions: Floats, normals: Floats, ratio: float) -> Floats:
    """Return unit vectors behind a face; `ratio` is the index before it over that behind it."""
    cosine = (directions * normals).sum(axis=0)
    behind = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    bent: Floats = ratio * directions + (behind - ratio * cosine) * normals
    return bent
