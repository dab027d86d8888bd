# SPDX-License-Identifier: Apache-2.0
"""Offsets that faults add to the numbers of a reading, for every installed kind of sensor.

A value that is none (NaN, infinite) stays as it is. Covariances stay: a broken device does not know
that it is broken.
"""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.messages.base import BusMessage, Reading
from groundlink.scenario.sensor_kinds import load_reference, sensor_kinds

Offsets = Callable[[int, int], Floats]
"""Returns offsets of shape (measurements, components)."""

Change = Callable[[Any, Offsets], Any]
"""Returns a reading with offsets added to one of its quantities."""


@cache
def changes_of(message: type[BusMessage]) -> dict[str, Change]:
    """Return how to add to each quantity of a message, the first being the default one.

    Labels have none.
    """
    changes: dict[str, Change] = {}
    for kind in sensor_kinds().values():
        if kind.streams[""] is message:
            for name, quantity in kind.spec.quantities.items():
                if name in kind.disturb:
                    changes[name] = load_reference(kind.disturb[name])
                else:
                    changes[name] = partial(_add, quantity.field, len(quantity.components))
    return changes


@cache
def cover_of(message: type[BusMessage]) -> Callable[[Any, float, float], Any]:
    """Return the function that removes a sector, begin and width in radians, from a message.

    Labels stay as they are.
    """
    for kind in sensor_kinds().values():
        if kind.cover and kind.streams[""] is message:
            cover: Callable[[Any, float, float], Any] = load_reference(kind.cover)
            return cover
    return lambda reading, begin_rad, width_rad: reading


def _add(field: str, components: int, reading: Reading, offsets: Offsets) -> Reading:
    """Add to a field that holds one number, or one for each component."""
    summed = (np.array(getattr(reading, field)) + offsets(1, components or 1)[0]).tolist()
    return replace(reading, **{field: tuple(summed) if components else summed[0]})


def within_limits(range_m: Floats, least_m: float, most_m: float) -> Floats:
    """Return distances as a device with limits says them (REP 117)."""
    finite = np.isfinite(range_m)
    reported = np.where(finite & (range_m > most_m), np.inf, range_m)
    return np.where(finite & (range_m < least_m), -np.inf, reported)


def within(
    azimuth_rad: NDArray[np.floating], begin_rad: float, width_rad: float
) -> NDArray[np.bool_]:
    """Return which azimuths are in the sector that goes counter-clockwise from `begin_rad`."""
    inside: NDArray[np.bool_] = (azimuth_rad - begin_rad) % (2 * math.pi) <= width_rad
    return inside
