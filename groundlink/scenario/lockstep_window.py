# SPDX-License-Identifier: Apache-2.0
"""How far physics may be ahead of others in lockstep, with a wall clock or without.

Rule: at least a period of the clock, by which the gateway tells its progress. At most so far that
a sensor which crashed can be started again without a gap: it begins where its oldest measurement
under way began (a revolution, an exposure, a message that a fault holds up), and physics keeps its
last `HISTORY_TICKS` states.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from groundlink.core.clock import TICK_RATE_HZ

from .every_sensor import SensorSpec
from .faults import Delay
from .schema import Time

HISTORY_TICKS = 1024
"""States that physics keeps for sensors that rejoin."""


def window_mistake(time: Time, sensors: Iterable[SensorSpec]) -> str | None:
    """Return what is wrong with the window of a run in lockstep, or None."""
    window = time.window_ticks
    if window < TICK_RATE_HZ / time.clock_rate_hz:
        return (
            f"{window} is less than a period of the clock; expected {TICK_RATE_HZ}/clock_rate_hz "
            "or more"
        )
    for sensor in sensors:
        most = HISTORY_TICKS - 2 - math.ceil(TICK_RATE_HZ * _under_way_s(sensor))
        if window > most:
            return (
                f"{window} and a measurement of `{sensor.name}` are more than the {HISTORY_TICKS} "
                f"ticks that are kept for its restart; expected {most} or less"
            )
    return None


def _under_way_s(sensor: SensorSpec) -> float:
    """Return how long after it began a measurement is published at the latest."""
    late_s = max((fault.delay_s for fault in sensor.faults if isinstance(fault, Delay)), default=0)
    return late_s + sensor.measuring_s
