# SPDX-License-Identifier: Apache-2.0
"""Firings of a LiDAR as a table: what each laser measured at each azimuth step."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

GAP = 8
"""Empty firings between clouds, so that no window of firings spans two of them."""

_REGULAR = 0.5
"""Greatest deviation of an azimuth step from the usual one, as a share of it."""


class Firings(NamedTuple):
    """Consecutive firings of a device."""

    range_m: Reals
    """Shape (firings, lasers); 0 where nothing returned."""

    intensity: Reals
    """The same shape, as the device reports it."""

    step_rad: float
    """Azimuth between two firings."""


def joined(parts: Iterable[Firings]) -> Firings:
    """Return firings of several recordings of one device, with gaps between them."""
    parts = list(parts)
    gap = np.zeros((GAP, parts[0].range_m.shape[1]))
    ranges, intensities = (
        [array for part in parts for array in (part[field], gap)] for field in range(2)
    )
    steps = [part.step_rad for part in parts]
    return Firings(np.concatenate(ranges), np.concatenate(intensities), float(np.median(steps)))


def of_head(azimuth_rad: Reals, range_m: Reals, intensity: Reals) -> Firings:
    """Return firings by the azimuth of the head at each, with gaps where firings are missing.

    Parameters
    ----------
    azimuth_rad : shape (firings,)
        Any direction of rotation; it may wrap.
    range_m, intensity : shape (firings, lasers)
    """
    turned = np.abs(_wrapped(np.diff(azimuth_rad)))
    step = float(np.median(turned))
    breaks = np.flatnonzero(np.abs(turned - step) > _REGULAR * step + 1e-4) + 1
    places = np.arange(len(azimuth_rad))
    for place in breaks:
        places[place:] += GAP
    shape = places[-1] + 1, range_m.shape[1]
    wide = np.zeros((2, *shape))
    wide[0, places], wide[1, places] = range_m, intensity
    return Firings(wide[0], wide[1], step)


def of_cloud(points: NDArray[np.void]) -> Firings:
    """Return the firings of one cloud with the fields x, y, z, ring and intensity.

    Points of a ring must be in the order in which they were measured. Each ring is placed by its
    own azimuth steps: rings are not aligned with each other.
    """
    position = np.stack([points[axis].astype(np.float64) for axis in "xyz"])
    range_m = np.sqrt((position**2).sum(axis=0))
    azimuth = np.arctan2(position[1], position[0])
    rings = np.unique(points["ring"])
    of_rings = [np.flatnonzero((points["ring"] == ring) & (range_m > 0)) for ring in rings]
    turns = [np.abs(_wrapped(np.diff(azimuth[own]))) for own in of_rings]
    # Returns of one ray have one azimuth, and missing returns make steps of several firings.
    steps = np.concatenate(turns)
    step = float(np.median(steps[steps > 1e-5]))
    columns = [
        np.cumsum(np.rint(np.concatenate([[0.0], turned]) / step)).astype(np.intp)
        for turned in turns
    ]
    wide = np.zeros((2, max((own[-1] + 1 for own in columns if len(own)), default=0), len(rings)))
    for ring, (own, column) in enumerate(zip(of_rings, columns, strict=True)):
        wide[0, column, ring], wide[1, column, ring] = range_m[own], points["intensity"][own]
    return Firings(wide[0], wide[1], step)


def _wrapped(angle: Reals) -> Reals:
    wrapped: Reals = np.remainder(angle + np.pi, 2 * np.pi) - np.pi
    return wrapped
